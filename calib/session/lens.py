"""The lens models that a session can name, and the names of their coefficients."""

OPENCV = "opencv"
FISHEYE = "fisheye"
SPLINED = "splined"
AUTO = "auto"
"""The model that predicts held-out views best."""

COEFFICIENTS = (0, 4, 5, 8, 12, 14)
"""The possible numbers of distortion coefficients in OpenCV's model."""

NAMES = {
    OPENCV: (
        "k1",
        "k2",
        "p1",
        "p2",
        "k3",
        "k4",
        "k5",
        "k6",
        "s1",
        "s2",
        "s3",
        "s4",
        "tau_x",
        "tau_y",
    ),
    FISHEYE: ("kb1", "kb2", "kb3", "kb4"),
    SPLINED: ("kb1", "kb2", "kb3", "kb4"),
}
"""The coefficients of each model, in the order of cv2 and cv2.fisheye. The fisheye's have distinct
names, so that no k1 is taken for the other model's.
"""

RADIAL_POWERS = {
    **{"k1": 2, "k2": 4, "k3": 6, "k4": 2, "k5": 4, "k6": 6},
    **{"kb1": 2, "kb2": 4, "kb3": 6, "kb4": 8},
}
"""The power of the distance from the axis, or of the angle, by which each radial coefficient
changes it.
"""

COUNTS = {OPENCV: COEFFICIENTS, FISHEYE: (4,), SPLINED: (4,)}
"""The possible numbers of coefficients in each model."""

MODELS = tuple(NAMES)
LENSES = (AUTO, *MODELS)
"""What a session may ask for."""
