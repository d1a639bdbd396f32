"""Advice for users whose views without the cover do not determine the intrinsics."""

TILT = "tilt the board by about 30 degrees, to each side and up and down, in 6 views"
NO_FIT = f"No intrinsics fit these views: check board.columns and board.rows, and {TILT}."
