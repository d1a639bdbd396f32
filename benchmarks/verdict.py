"""The verdicts on rendered and on synthetic sessions, and their time: the figures of
docs/development/accuracy.md.

`python -m benchmarks.verdict` for the rendered ones, `python -m benchmarks.verdict synthetic` for
random ones without any fault.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

from calib.corners.corners_file import write_corners
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.session.camera import Camera
from calib.session.freeing import ALL, AUTO
from calib.session.session import read_session, session_to_yaml
from calib.threads import single_thread
from calib.verdict.judge import judge
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, paper_cone, scene

FIXTURES = Path(__file__).parents[1] / "fixtures"
RENDERED = ("clean", "tilted", "bumps", "bow", "shutter", "stretch", "two", "wave", "bump")
SEEDS = range(100, 114)


def rows(name: str, folder: Path) -> Iterator[str]:
    """A session's, as by default and with all numbers free."""
    session = read_session(folder)
    for free, words in ((AUTO, "as by default"), (ALL, "all free")):
        calibration = fit(session, Settings(free=(free,)))
        with single_thread():
            start_time = time.process_time()
            verdict = judge(calibration)
            spent = time.process_time() - start_time
        command = " ".join(verdict.next.split()[:2])
        yield (
            f"| {name} | {words} | {verdict.word.value} | {', '.join(verdict.suspects)} |"
            f" `{command}` | {spent:.2f} |"
        )


def faultless(seed: int, rng: np.random.Generator) -> tuple[str, Scene]:
    """A synthetic scene, and what it is of."""
    views, noise, bumps = (
        int(rng.integers(15, 30)),
        float(rng.choice([0.02, 0.05, 0.1, 0.2])),
        float(rng.choice([1e-6, 5e-6, 1e-5])),
    )
    glass = float(rng.choice([0.00115, 0.003, 0.005]))
    made = scene(
        seed, views=views, noise=noise, amplitude=bumps, depths=(0.3, 1.2), cover=paper_cone(glass)
    )
    return f"{views} views, {noise:g} px, bumps of {1e6 * bumps:g} µm on {1e3 * glass:g} mm", made


def main() -> None:
    """The tables."""
    print(
        "| session | numbers | word | suspects | next | judged in, s |\n|---|---|---|---|---|---|"
    )
    if sys.argv[1:] != ["synthetic"]:
        for name in RENDERED:
            print(*rows(name, FIXTURES / name), sep="\n", flush=True)
        return
    rng = np.random.default_rng(5)
    for seed in SEEDS:
        title, made = faultless(seed, rng)
        with TemporaryDirectory() as folder:
            setup = session_to_yaml(
                made.board, Camera(WIDTH, HEIGHT, intrinsics=INTRINSICS), made.cover
            )
            (Path(folder) / "session.yaml").write_text(
                yaml.safe_dump({"format": 1, **setup, "corners": "corners.vnl"})
            )
            write_corners(Path(folder) / "corners.vnl", made.views)
            print(*rows(title, Path(folder)), sep="\n", flush=True)


if __name__ == "__main__":
    main()
