"""The lens models that a session can name, and what each calls its coefficients."""

OPENCV, FISHEYE, SPLINED = "opencv", "fisheye", "splined"
AUTO = "auto"
"""Whichever predicts held-out views best."""

COEFFICIENTS = (0, 4, 5, 8, 12, 14)
"""How many distortion coefficients OpenCV's model may have."""

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
"""Of each model's coefficients, in the order of cv2 and cv2.fisheye. The fisheye's have names of
their own, so that no k1 is taken for the other model's.
"""

COUNTS = {OPENCV: COEFFICIENTS, FISHEYE: (4,), SPLINED: (4,)}
"""How many coefficients a lens of each model may have."""

MODELS = tuple(NAMES)
