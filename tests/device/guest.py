"""A small virtual machine that runs one command of the tests' and ends."""

import platform
import shlex
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.device.initramfs import initramfs
from tests.device.kernels import BOOKWORM, Kernel
from tests.device.packages import MissingError

PROJECT = Path(__file__).resolve().parents[2]
FILE_SYSTEMS = ("virtio_pci", "virtio_rng", "9pnet_virtio", "9p", "overlay")
ARGUMENTS = (
    "console=ttyS0 quiet panic=-1 mitigations=off nokaslr random.trust_cpu=on no_timer_check"
    " tsc=unstable clocksource=acpi_pm"
)
"""The clock is one whose rate is fixed: the processor's own is measured at the boot, and on a busy
machine came out ten times too fast.
"""
ENVIRONMENT = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME": "/root",
    "LC_ALL": "C.UTF-8",
    "PYTHONPATH": str(PROJECT),
    "PYTHONDONTWRITEBYTECODE": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "NO_COLOR": "1",
}


FREE = ("-accel", "tcg,thread=multi", "-smp", "2")
COUNTED = ("-accel", "tcg,thread=single", "-smp", "1", "-icount", "shift=0,align=off,sleep=on")
BOOTED = b"booted in"
"""The line that init.sh prints."""
BOOT_S = 120.0
"""Ten times what a boot takes on a busy machine."""
BOOTS = 3


class GuestError(Exception):
    """The guest did not do what it was started for; the message ends with what it printed."""


@dataclass(frozen=True, slots=True)
class Guest:
    kernel: Kernel
    modules: Mapping[str, str]
    """To be loaded, with their parameters."""
    built: Sequence[Path] = ()
    """Files of modules that are not the kernel's own."""
    root: Path = Path("/")
    """The folder of this machine that the guest sees as its root, and cannot change."""
    silence: float = 600.0
    """Seconds without a word on its console, after which it is stopped: it may be slow on a busy
    machine, but not stand still.
    """

    counted: bool = False
    """True for a guest whose clock counts its own work, a nanosecond an instruction, about what a
    Raspberry Pi does: what takes a second there takes a second, however busy this machine is. It
    has one processor.
    """

    def run(self, shared: Path, *command: str, **environment: str) -> None:
        """Boot, run a command in a guest that has `shared` as /shared and this machine's root as
        /host, and halt.
        """
        variables = [
            f"export {name}={shlex.quote(value)}"
            for name, value in {**ENVIRONMENT, **environment}.items()
        ]
        (shared / "job").write_text("\n".join([*variables, f"exec {shlex.join(command)}", ""]))
        archive = shared / "initramfs"
        modules = {**dict.fromkeys(FILE_SYSTEMS, ""), **self.modules}
        archive.write_bytes(
            initramfs(_busybox(), self.kernel.modules, modules, root=self.root, built=self.built)
        )
        log = shared / "console"
        if not any(
            self._ends([*_qemu(), *self._machine(shared, archive)], log) for _ in range(BOOTS)
        ):
            raise GuestError(
                f"The guest did not boot within {BOOT_S:.0f} s, {BOOTS} times:\n{_tail(log)}"
            )
        code = shared / "code"
        if not code.exists() or code.read_text().strip() != "0":
            raise GuestError(f"The guest's command failed:\n{_tail(log)}")

    def _ends(self, command: Sequence[str], log: Path) -> bool:
        """Whether it booted; then it has also ended.

        A boot now and then hangs before its first process, emulated as it is.
        """
        with (
            log.open("wb") as console,
            subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=console, stderr=console
            ) as process,
        ):
            try:
                until = time.monotonic() + BOOT_S
                while process.poll() is None and BOOTED not in log.read_bytes():
                    if time.monotonic() > until:
                        return False
                    time.sleep(0.2)
                self._wait(process, log)
            finally:
                process.kill()
        return True

    def _wait(self, process: subprocess.Popen[bytes], log: Path) -> None:
        size, since = 0, time.monotonic()
        while process.poll() is None:
            if (new_size := log.stat().st_size) != size:
                size, since = new_size, time.monotonic()
            elif time.monotonic() - since > self.silence:
                raise GuestError(f"The guest said nothing for {self.silence:.0f} s:\n{_tail(log)}")
            time.sleep(0.2)

    def _machine(self, shared: Path, archive: Path) -> list[str]:
        return [
            *(COUNTED if self.counted else FREE),
            *("-cpu", "max", "-m", "2048"),
            *(
                "-nodefaults",
                "-nographic",
                "-no-reboot",
                "-serial",
                "stdio",
                "-nic",
                "none",
                "-device",
                "virtio-rng-pci",
            ),
            *("-kernel", str(self.kernel.image), "-initrd", str(archive), "-append", ARGUMENTS),
            *("-fsdev", "local,id=host,path=/,security_model=none,readonly=on,multidevs=remap"),
            *("-device", "virtio-9p-pci,fsdev=host,mount_tag=host"),
            *("-fsdev", f"local,id=shared,path={shared},security_model=none"),
            *("-device", "virtio-9p-pci,fsdev=shared,mount_tag=shared"),
        ]


def prepare() -> None:
    """Fetch what every guest needs beside its kernel."""
    if platform.machine() != "x86_64":
        raise MissingError(
            f"This machine is {platform.machine()}: guests run its own programs, and are made for"
            " x86_64."
        )
    _busybox()
    _qemu()


def _busybox() -> Path:
    return BOOKWORM.unpacked("busybox", alone=("busybox-static",)) / "bin/busybox"


def _qemu() -> list[str]:
    """Return the command of this machine's QEMU, or of Debian's started by the loader and with the
    libraries that belong to it.
    """
    if installed := shutil.which("qemu-system-x86_64"):
        return [installed]
    tree = BOOKWORM.unpacked("qemu", ("qemu-system-x86",))
    libraries = tree / "usr/lib/x86_64-linux-gnu"
    data = [
        word for folder in ("qemu", "seabios") for word in ("-L", str(tree / "usr/share" / folder))
    ]
    loader = [str(libraries / "ld-linux-x86-64.so.2"), "--library-path", str(libraries)]
    return [
        "env",
        f"QEMU_MODULE_DIR={libraries / 'qemu'}",
        *loader,
        str(tree / "usr/bin/qemu-system-x86_64"),
        *data,
    ]


def _tail(log: Path) -> str:
    return "\n".join(log.read_text(errors="replace").splitlines()[-40:])
