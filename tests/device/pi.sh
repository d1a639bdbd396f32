#!/usr/bin/env bash
# Detection, gate and fit with the real aarch64 wheels on an emulated Cortex-A72, the processor of a Raspberry Pi 4; they must give what
# they give here. PYTHON names the project's interpreter (default: python3). Exit code 77: something is missing, and nothing was tested.
set -euo pipefail
cd "$(dirname "$0")/../.."
python=${PYTHON:-python3}
parts=$("$python" -m tests.device.pi)
read -r root wheels emulator <<<"$parts"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
export PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

pi() {
  PYTHONPATH=$PWD:$wheels "$emulator" -cpu cortex-a72 -L "$root" "$root/usr/bin/python3.13" "$@"
}

record_and_fit() { # by the interpreter that the other words call, into the folder that the first names
  local to=$folder/$1 fixture=fixtures/bumps/holdout
  shift
  mkdir "$to"
  "$@" -m capture record "$to/session" --source "folder:$fixture?speed=max" --cover-from $fixture/session.yaml \
    --board 9x9 --square-mm 20 --json | sed "s#$to/##" >"$to/record.json"
  "$@" -m calib fit "$to/session" -o "$to/calibration" --json >"$to/fit.json"
}

record_and_fit here "$python"
record_and_fit pi pi
"$python" -m tests.device.compare "$folder/pi" "$folder/here"
