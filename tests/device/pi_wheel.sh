#!/usr/bin/env bash
# Both ways of docs/raspberry-pi.md on an emulated Raspberry Pi 4, each by the Pi's own pip: what records without torch, in an environment
# that sees the system's libcamera; and .ci/smoke, which installs the wheel into an empty one with all that it depends on, and calibrates.
# The kernel must start arm64 programs by qemu-aarch64-static (Debian: sudo apt install qemu-user-static, and binfmt-support where systemd
# does not do it). PYTHON names the project's interpreter (default: python3). Exit code 77: nothing was tested.
#   tests/device/pi_wheel.sh [WHEEL]
set -euo pipefail
wheel=${1:+$(realpath "$1")}
cd "$(dirname "$0")/../.."
python=$(realpath -s "$(command -v "${PYTHON:-python3}")")
root=$("$python" -m tests.device.pi root)
export QEMU_CPU=cortex-a72 QEMU_LD_PREFIX=$root
if ! "$root/usr/bin/python3.13" -c "" 2>/dev/null; then
  echo "SKIPPED: this machine does not start programs of arm64: sudo apt install qemu-user-static binfmt-support." >&2
  exit 77
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
if [ -z "$wheel" ]; then
  "$python" -m build --outdir "$folder" >&2
  wheel=$(echo "$folder"/*.whl)
fi
cat >"$folder/python" <<END # Debian's ensurepip looks for pip at its place on a Pi, where this machine has none
#!/usr/bin/env bash
set -e
[ "\$1 \$2" = "-m venv" ] || exec "$root/usr/bin/python3.13" "\$@"
"$root/usr/bin/python3.13" -m venv --without-pip "\${@:3}"
"$python" -m zipfile -e "$root"/usr/share/python-wheels/pip-*.whl "\${@: -1}/lib/python3.13/site-packages"
END
chmod +x "$folder/python"

"$folder/python" -m venv --system-site-packages "$folder/recorder"
"$folder/recorder/bin/python" -m pip install -q -r docs/requirements/capture.txt
"$folder/recorder/bin/python" -m pip install -q --no-deps "$wheel"
"$folder/recorder/bin/capture" sources | tee "$folder/sources"
grep -q "libcamera: libcamera sees no camera" "$folder/sources" # its bindings were found
fixture=$PWD/fixtures/bumps/holdout
"$folder/recorder/bin/capture" record "$folder/session" --source "folder:$fixture?speed=max" --cover-from "$fixture/session.yaml" \
  --board 9x9 --square-mm 20 --views 10
echo "It recorded without torch, in $(du -sm "$folder/recorder" | cut -f1) MB."

PYTHON=$folder/python .ci/smoke "$wheel"
