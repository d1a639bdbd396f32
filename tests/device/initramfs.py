"""The guest's first file system: busybox, init.sh and the kernel modules that it loads, as one
archive.
"""

import gzip
import lzma
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

FOLDERS = ("bin", "modules", "proc", "sys", "dev", "host", "memory", "root")
DEPENDS = re.compile(rb"\0depends=([^\0]*)\0")


def initramfs(
    busybox: Path,
    kernel_modules: Path,
    modules: Mapping[str, str],
    *,
    root: Path,
    built: Sequence[Path] = (),
) -> bytes:
    """A compressed cpio archive.

    Args:
        busybox: a static one.
        kernel_modules: folder of the kernel's own modules.
        modules: names of those to load, in order, with their parameters.
        root: folder of the host that becomes the guest's root.
        built: module files that are not the kernel's own.
    """
    results = {_name(file): file for file in (*kernel_modules.rglob("*.ko*"), *built)}
    loaded: dict[str, bytes] = {}
    for name in modules:
        _add(name, results, loaded)
    entries = [(folder, 0o040755, b"") for folder in FOLDERS]
    entries += [(f"modules/{name}.ko", 0o100644, module) for name, module in loaded.items()]
    entries += [
        ("bin/busybox", 0o100755, busybox.read_bytes()),
        ("init", 0o100755, Path(__file__).with_name("init.sh").read_bytes()),
        (
            "modules.list",
            0o100644,
            "".join(f"{name}.ko {modules.get(name, '')}\n" for name in loaded).encode(),
        ),
        ("root.path", 0o100644, str(root).encode()),
    ]
    return gzip.compress(
        b"".join(_member(*entry) for entry in (*entries, ("TRAILER!!!", 0, b""))), compresslevel=1
    )


def _add(name: str, modules: Mapping[str, Path], loaded: dict[str, bytes]) -> None:
    """Add the dependencies of a module, then the module; nothing if it is built into the kernel."""
    if name in loaded or name not in modules:
        return
    module = modules[name].read_bytes()
    if modules[name].suffix == ".xz":
        module = lzma.decompress(module)
    depends = DEPENDS.search(module)
    for dependency in depends[1].decode().split(",") if depends else ():
        _add(dependency.replace("-", "_"), modules, loaded)
    loaded[name] = module


def _name(file: Path) -> str:
    return file.name.split(".ko")[0].replace("-", "_")


def _member(name: str, mode: int, content: bytes) -> bytes:
    """One file in the format that the kernel unpacks: newc."""
    path = name.encode() + b"\0"
    parameters = (0, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(path), 0)
    head = b"070701" + b"".join(b"%08x" % number for number in parameters) + path
    return head + bytes(-len(head) % 4) + content + bytes(-len(content) % 4)
