"""The sensors of cameras that libcamera names, and their shutters."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.session.board import Board
from calib.session.shutter import Shutter
from capture.frames import Frame
from capture.recorder import Recorder
from capture.sensors import sensor_in, shutter_of

BOARD = Board(9, 9, 0.02)


@pytest.mark.parametrize(
    ("words", "sensor"),
    [
        ("/base/soc/i2c0mux/i2c@1/imx219@10", "imx219"),
        ("/base/axi/pcie@1000120000/rp1/i2c@88000/imx708_wide@1a", "imx708"),
        (
            (
                "INFO RPI pisp.cpp:1450 Sensor: /base/axi/pcie@120000/rp1/i2c@80000/imx477@1a -"
                " Selected sensor format: 2028x1520"
            ),
            "imx477",
        ),
        ("_SB_.PCI0.XHC_.RHUB.HS07-7:1.0-0408:a061", ""),
        ("Virtual0", ""),
    ],
)
def test_the_sensor_stands_in_the_id(words: str, sensor: str) -> None:
    assert sensor_in(words) == sensor


def test_shutters() -> None:
    assert shutter_of("imx296") == Shutter(rolling=False)
    assert shutter_of("imx219") == Shutter(rolling=True)
    assert shutter_of("imx999") is None
    assert shutter_of("") is None


def recorded(session: Path, shutter: Shutter | None) -> list[str]:
    """Return the remarks of a recording."""
    with Recorder(session, BOARD, shutter=shutter) as recorder:
        recorder.keep(Frame(np.zeros((48, 64), np.uint8), 0, 0.0, {}))
        return recorder.remarks


def described(session: Path) -> object:
    return yaml.safe_load((session / "session.yaml").read_text())["camera"].get("shutter")


def test_a_session_gets_the_shutter_of_the_driver_s_sensor(tmp_path: Path) -> None:
    recorded(tmp_path / "told", Shutter(rolling=False))
    assert described(tmp_path / "told") == {"type": "global"}
    recorded(tmp_path / "untold", None)
    assert described(tmp_path / "untold") is None


def test_a_session_without_the_sensor_s_shutter_gets_a_request(tmp_path: Path) -> None:
    """A value that a person has written is not rewritten."""
    recorded(tmp_path, None)
    (text,) = recorded(tmp_path, Shutter(rolling=True))
    assert text.startswith(
        "The camera's sensor has a rolling shutter: write camera.shutter: {type: rolling} in "
    )
    file = tmp_path / "session.yaml"
    file.write_text(
        file.read_text().replace(
            "height: 48", "height: 48\n  shutter: {type: rolling, readout_ms: 20}"
        )
    )
    assert recorded(tmp_path, Shutter(rolling=True)) == []
    (text,) = recorded(tmp_path, Shutter(rolling=False))
    assert text.endswith("(it says rolling).")
