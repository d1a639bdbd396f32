#!/usr/bin/env bash
# Which of PyPI's aarch64 wheels of torch a Raspberry Pi could load, and what they ask for (docs/decisions/torch.md): each wheel's size, how
# many requirements for CUDA hold on every Linux, and whether its libc10.so, which torch 2.10 dies in, loads on an emulated Pi 4 and Pi 5.
# PYTHON names the project's interpreter (default: python3); half a GB is fetched for each of the later versions, and not kept.
#   tests/device/pi_torch.sh VERSION...
set -euo pipefail
cd "$(dirname "$0")/../.."
python=${PYTHON:-python3}
read -r root emulator <<<"$("$python" -m tests.device.pi root emulator)"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for version in "$@"; do
  "$python" -m pip download -q --no-deps --only-binary=:all: --python-version 3.13 --platform manylinux_2_28_aarch64 -d "$folder" "torch==$version"
  wheel=$(echo "$folder"/torch-"$version"*.whl)
  asked=$(unzip -p "$wheel" 'torch-*.dist-info/METADATA' | grep -iE '^Requires-Dist: (cuda|nvidia|triton)' | grep -vcE 'platform_machine|extra ==') || true
  unzip -q -o -j "$wheel" torch/lib/libc10.so 'torch.libs/libgomp*' 'torch/lib/libgomp*' -d "$folder/$version" 2>/dev/null || true
  said="torch $version: $(($(stat -c %s "$wheel") / 1000000)) MB, $asked requirements for CUDA without the machine's name"
  for processor in cortex-a72 cortex-a76; do
    code=0
    load="import ctypes, glob; [ctypes.CDLL(lib, ctypes.RTLD_GLOBAL) for lib in sorted(glob.glob('$folder/$version/*'), reverse=True)]"
    { "$emulator" -cpu "$processor" -L "$root" "$root/usr/bin/python3.13" -c "$load" >/dev/null || code=$?; } 2>/dev/null
    said+="; $processor: $([ $code -eq 0 ] && echo loads || echo "ends with $code")"
  done
  echo "$said"
  rm -rf "$wheel" "${folder:?}/$version"
done
