"""The parts of the guests: two kernels, the one module that is built, and a root with libcamera."""

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from tests.device.packages import Apt, MissingError, cache

BOOKWORM, TRIXIE = Apt("bookworm"), Apt("trixie")


@dataclass(frozen=True, slots=True)
class Kernel:
    tree: Path
    """The folder of the unpacked packages."""
    release: str
    """The release's name, such as 6.1.0-56-amd64."""

    @property
    def image(self) -> Path:
        return self.tree / "boot" / f"vmlinuz-{self.release}"

    @property
    def modules(self) -> Path:
        return self.tree / "lib" / "modules" / self.release / "kernel"


def kernel_6_1() -> Kernel:
    """Debian bookworm's, which has vivid, with the headers and sources that v4l2loopback is built
    from.
    """
    release = BOOKWORM.newest(r"^linux-image-6\.1\.0-[0-9]+-amd64$").removeprefix("linux-image-")
    headers = (
        f"linux-headers-{release}",
        f"linux-headers-{release.removesuffix('-amd64')}-common",
        "linux-kbuild-6.1",
    )
    packages = (f"linux-image-{release}", *headers, "v4l2loopback-dkms")
    return Kernel(BOOKWORM.unpacked(f"kernel-{release}", alone=packages), release)


def kernel_6_12() -> Kernel:
    """Debian trixie's, which has the memory that libcamera's virtual camera writes to."""
    image = TRIXIE.newest(r"^linux-image-6\.12\.[0-9]+[+]deb13-amd64$")
    release = image.removeprefix("linux-image-")
    return Kernel(TRIXIE.unpacked(f"kernel-{release}", alone=(image,)), release)


def v4l2loopback(kernel: Kernel) -> Path:
    """The module, built by this machine's compiler; made once."""
    built = cache() / f"v4l2loopback-{kernel.release}"
    module = built / "v4l2loopback.ko"
    if module.exists():
        return module
    for program in ("gcc", "make"):
        if not shutil.which(program):
            raise MissingError(
                f"{program} is missing: building v4l2loopback needs it, so run sudo apt install"
                f" {program}."
            )
    shutil.rmtree(built, ignore_errors=True)
    shutil.copytree(next((kernel.tree / "usr/src").glob("v4l2loopback-*")), built)
    headers = kernel.tree / "usr/src" / f"linux-headers-{kernel.release}"
    makefile = headers / "Makefile"  # includes the common one from where it would be installed
    makefile.write_text(
        makefile.read_text().replace("include /usr/src/", f"include {kernel.tree}/usr/src/")
    )
    made = subprocess.run(
        ["make", "-C", headers, f"M={built}", "CC=gcc", "modules"],
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode:
        raise RuntimeError(
            f"v4l2loopback does not build for Linux {kernel.release}:\n{made.stdout}{made.stderr}"
        )
    return module


def libcamera_root() -> Path:
    """Debian trixie, as far as libcamera's Python bindings need it: the first release whose
    libcamera has a virtual camera.
    """
    return TRIXIE.unpacked("libcamera", ("base-files", "dash", "python3", "python3-libcamera"))
