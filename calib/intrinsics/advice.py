"""What people are asked for whose views without the cover tell too little."""

TILT = "tilt the board by about 30 degrees, to each side and up and down, in 6 views"
NO_FIT = f"No intrinsics fit these views: check board.columns and board.rows, and {TILT}."
