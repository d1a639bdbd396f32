"""The data: the worst word stands, and the gravest reason says what to do next."""

from calib.verdict.verdict import MAPS_HOLD, Reason, Trust, Verdict

CARE = Reason("it is small.", "calib diagnose here", ("cover.thickness", "camera.fx"))
BAD = Reason("it is wrong.", "calib fit there", ("camera.fx",), Trust.DO_NOT_USE)


def test_no_reasons_are_trust() -> None:
    verdict = Verdict((), "calib export it")
    assert verdict.as_json() == {
        "word": "trusted",
        "maps_hold": True,
        "reasons": [],
        "suspects": [],
        "next": "calib export it",
        "notes": [],
    }
    assert str(verdict) == "You can trust this calibration where the board was in the picture."


def test_the_gravest_reason_decides() -> None:
    verdict = Verdict((CARE, BAD), "calib export it", notes=("it has a twin.",))
    assert verdict.as_json() == {
        "word": "do_not_use",
        "maps_hold": False,
        "reasons": ["it is small.", "it is wrong."],
        "suspects": ["camera.fx", "cover.thickness"],
        "next": "calib fit there",
        "notes": ["it has a twin."],
    }
    assert str(verdict) == "Do not use it. It is small. It is wrong."


def test_a_reason_about_a_number_alone_leaves_the_maps() -> None:
    number = Reason("it is not determined.", "measure it", maps_hold=True)
    verdict = Verdict((number,), "calib export it")
    assert (verdict.as_json()["word"], verdict.as_json()["maps_hold"]) == ("care", True)
    assert verdict.headline == MAPS_HOLD
    assert not Verdict((number, CARE), "").maps_hold


def test_the_first_of_equally_grave_reasons_decides() -> None:
    assert Verdict((CARE, Reason("later.", "capture it")), "").next == CARE.next
