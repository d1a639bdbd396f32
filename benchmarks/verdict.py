"""What the verdict says of the rendered sessions, and how long it takes: the table of docs/verdict.md. `python -m benchmarks.verdict`"""

import time
from pathlib import Path

from calib.fitting.fit import fit
from calib.fitting.stages import Settings
from calib.session.session import read_session
from calib.threads import single_thread
from calib.verdict.judge import judge

FIXTURES = Path(__file__).parents[1] / "fixtures"
SESSIONS = ("clean", "tilted", "bumps", "bow", "shutter", "stretch", "two", "wave", "bump")


def main() -> None:
    """A row for each session: held and freed."""
    print("| session | numbers | word | suspects | next | judged in, s |\n|---|---|---|---|---|---|")
    for name in SESSIONS:
        session = read_session(FIXTURES / name)
        for free, said in (((), "held"), (("all",), "free")):
            calibration = fit(session, Settings(free=free))
            with single_thread():
                begun = time.process_time()
                verdict = judge(calibration)
                spent = time.process_time() - begun
            command = " ".join(verdict.next.split()[:2])
            print(f"| {name} | {said} | {verdict.word.value} | {', '.join(verdict.suspects)} | `{command}` | {spent:.2f} |", flush=True)


if __name__ == "__main__":
    main()
