"""What a diagnosis says on the screen. The JSON is `calib diagnose --json`'s."""

from typing import Any

from capture.tui.effects import told

CANDIDATE: dict[str, Any] = {"chi2": 2838.0, "dof": 2, "p_value": 0.0, "gain_ci95": [0.3, 0.5], "parameters": {}, "confounded_with": []}
DIAGNOSIS: dict[str, Any] = {
    "candidates": [
        {**CANDIDATE, "effect": "board_bow", "held_out_px_before": 0.59, "held_out_px_after": 0.17},
        {**CANDIDATE, "effect": "focal", "held_out_px_before": 0.59, "held_out_px_after": None},
    ],
    "accepted": ["board_bow"],
    "before": {"rms_px": 0.6, "rmse_cm": 0.05, "held_out_px": 0.59},
    "after": {"rms_px": 0.1, "rmse_cm": 0.01, "held_out_px": 0.17},
}


def test_what_was_found_with_the_error_before_and_after() -> None:
    lines = told(DIAGNOSIS).splitlines()
    assert lines[0] == "Effects found: board_bow."
    assert lines[5].split() == ["on", "held-out", "views,", "px", "0.5900", "0.1700"]
    assert [line.split()[0] for line in lines[8:]] == ["board_bow"]  # what was not refitted has no number to show
    assert max(map(len, lines)) < 80


def test_finding_nothing_is_said_as_a_result() -> None:
    nothing = {**DIAGNOSIS, "accepted": [], "candidates": []}
    assert told(nothing).startswith("Effects found: none: nothing that was tried improves")
