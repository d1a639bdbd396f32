"""The thresholds of the checks with their reasons, shown to readers in docs/verdict-checks.md."""

STATIONARY = 0.3
"""Standard deviations: the largest distance from the optimum of a fit that ended early but counts
as converged. At this distance sigma would be 4 % larger. In flat valleys, of numbers that the views
hardly determine, fits use up their steps 0.01 to 0.13 before the end.
"""

SMALLEST_BOARD = 1e-3
"""m, the width of a board: the smallest targets of microscopes are as wide."""
LARGEST_BOARD = 10.0
"""m: no board is wider, so a larger one is declared in another unit."""
SMALL_BOARD = 0.04
"""m: a narrower board may be declared in another unit. Boards of some centimetres are wider."""
TINY = 0.5
"""Width of a board over the radius of its cover: below it, the unit is wrong. A board of a few
centimetres may be narrower than its dome, but not by half.
"""
UNSURE_SQUARE = 0.01
"""Relative standard deviation of the squares' declared side. A ruler over several squares shows the
side to some permille, and a length that is wrong by more than a per cent is no measurement.
"""

WORSE_THAN_BARE = 1.5
"""Cover stage over pinhole stage. A cover that is described well lowers the error, and one of thin
glass hardly changes it.
"""
REFUTED = 1.03
"""Fitted cover over the camera alone, if each has a lens that was fitted to the pictures. A cover
that is not visible leaves the same error to a permille. A cone that was declared for a dome in
water left 1.04.
"""
NO_BETTER = 0.95
"""Fit with a cover over pinhole stage: above it, the cover explains nothing. Pictures without a
cover that declared one left 1.03, and the weakest cover of 22 simulated sessions 0.87.
"""
EXPLAINED = 3.0
"""Pinhole stage over the corners' noise: below it, the camera alone explains the pictures. A lens
that was found through the cover leaves little more than noise: only the cover's change with depth.
A lens that was found without the cover leaves a multiple of the noise
(tests/verdict/test_bare_pictures.py has covers of one and three millimetres).
"""
TAKEN_UP = 10.0
"""Cover stage over final stage with every number held. Uneven glass of 11 um alone makes 6
(`fixtures/bumps`). A wrong thickness, focal length or principal point makes 10 to 22.
"""
ASKING_ORIENTATION = 1.5
"""Cover stage over final stage: above it, other orientations are tried. Below it, the error of the
described cover is too small for pictures that are mirrored or turned.
"""
OTHER_ORIENTATION = 1 / 3
"""Cover stage of pictures that are turned back, over that of the pictures as they are. Numbers that
were wrong by their tolerances made it less than a half in one of a hundred sessions. Pictures that
are turned make it a tenth.
"""
OTHER_MEDIUM = 0.5
"""Cover stage with air for water, or water for air, over the declared one. A change of the index by
a third changes the bending of every ray by more than any other number can, so the right medium at
least halves the error.
"""
OTHER_MEDIUM_LOG_ODDS = 7.0
"""The log odds of the other medium that are a reason if other numbers are unknown: a thousand to
one. No rendered fixture in air has log odds above 0. Fixtures in water that are declared as in air
have 129 and more with an unknown thickness. With an unknown lens they have 236 and 346, but a dome
0. With every number unknown they have 10 behind a window and less than 0 behind a dome or a cone,
where air explains them as well (`python -m benchmarks.unknown --media`).
"""
SAME_INDEX = 0.02
"""The difference from the index of water below which the index of the glass is doubted. Covers are
of acrylic, 1.49, or have a larger index. Films of fluoropolymer, 1.34, are the exception; their fit
holds.
"""
SQUARE_PIXELS = 2e-3
"""The smallest relative difference of fx and fy that is a reason. The median of 31 measured sets is
1.4 permille after a diagnosis, and 2.8 before it.
"""
SQUARE_SIGMAS = 4.0
"""The smallest such difference, in standard deviations that count views."""
SCATTER = 2.0
"""The scatter of views or board corners over that of noise. Clean sessions have up to 1.4, the
fixtures that hide an effect 5 to 7.
"""

SCORED = 1e-3
"""The p-value of an effect's score, over all effects that are tested: one good calibration in a
thousand is doubted for it.
"""
AGREED = 0.01
"""The p-value of the views' agreement on an effect. Few views show an effect that the glass
imitates well: it is 0.0015 in `fixtures/stretch`.
"""
WORTH_NAMING = 0.01
"""The smallest predicted decrease of the error beyond chance: the diagnosis accepts nothing
smaller. Rendered sessions that hide nothing have 0.004 at most.
"""
NAMED_BESIDE = 0.5
"""Relative to the largest predicted decrease: other effects with a larger one may be the cause as
well.
"""
MOST_NAMED = 3
BEYOND_NOISE = 2.0
"""Error over the corners' noise. The noise is known to some per cent, and the poses of the views
absorb less than that.
"""

BESIDE_UNSEEN = 5
"""The number of views that show the last row but one of a board with markers, if no view shows the
last one. A board that reaches out of the picture on the same side in each of so many views was
hardly moved.
"""

FEW_CELLS = 0.5
"""The smallest fraction of the picture's cells with corners: with fewer, the model is extrapolated
to more than half of the picture.
"""
ONE_DEPTH = 1.5
"""Farthest over nearest corner. Lens and cover are told apart by what changes with depth. From 1 to
1.5 m, a third of the parallax changes.
"""
UNSURE = 0.5
"""px, predicted standard deviation of the maps at the corners: above it, a map may be wrong by more
than a pixel.
"""
UNSURE_FOCAL = 0.01
"""Standard deviation of the focal length over it: distances that are measured with it are as
uncertain.
"""
NOTICED_SCALE = 0.003
"""The smallest relative change of the scale of depth and length for which held numbers that the
views contradict are named: three standard deviations are then UNSURE_FOCAL. Rendered sessions with
a bent board, a rolling shutter or a stretched print change it by 0.0011 at most.
"""
UNBOUNDED_SCALE = 0.1
"""The standard deviation of the scale by the views alone above which no figure is given: most of it
then comes from the tolerance of a declared focal length.
"""
DOMINANT = 0.5
"""The smallest fraction of the scale's variance or change for which a number is named."""
TELLS = 2
"""Unknowns of camera and glass that one view of a flat board determines, besides its pose: a
homography has eight numbers, and the pose takes six (Z. Zhang, A flexible new technique for camera
calibration, 2000).
"""
FIGURE_UNKNOWNS = 15
"""Polynomials up to the fourth degree: the relief's prior leaves them free."""

CROPPED = 1.0
"""Sizes of the picture between its middle and the principal point. Beyond half of one, it lies
outside of the picture, as in a mode that reads out a corner of the sensor. No camera is known with
a mode beyond a whole one.
"""
SAME_SIZE = 0.06
"""The largest relative difference between twice the principal point and a sensor mode's size: three
standard deviations of how far lenses are mounted off the middle, 20 px of 1000.
"""
OTHER_SIZE = 0.15
"""The smallest relative difference between twice the principal point and the picture's size for
which other modes are tried.
"""
FIELD = (0.3, 6.0)
"""Focal length over the picture's width, from a lens of 118 degrees to one of 10: the pinhole
cameras that look through covers.
"""

INSIDE = 1.2
"""Median distance of the corners from the pinhole over that of the glass: below it, the board would
touch the cover when it is tilted.
"""
REACHED_GLASS = 0.01
"""The largest fraction of the corners that may seem to be inside the cover: a board may touch it,
and the estimate may be a little wrong.
"""
FAR_AWAY = 1000.0
"""The same ratio as INSIDE, for boards that are too far away: a board that fills a part of the
picture at 40 m, with a cover of 40 mm, is as large as a house.
"""
SMALL_RADIUS = 0.01
"""m: few cameras fit behind a cover of 10 mm. If the radius of a dome or tube of 25 to 100 mm is
written in centimetres, it becomes 2.5 to 10 mm.
"""
THIN_COVER = 0.0005
"""m: the thinnest glass of a cover that is not flat, which may be a film."""
SMALL_COVER = 0.02
"""m: the smallest distance of a cover for FAR_AWAY. A window right before the lens has no bearing
on the distance of boards.
"""

HELD_OUT_ELSEWHERE = 10.0
"""Held-out over fitted error of pictures of another camera, cover or board: they have 20 and more.
"""
MIN_ELSEWHERE = 0.5
"""px: smaller errors do no harm, whatever the ratio."""
HELD_OUT = 1.5
"""Held-out over fitted error. Held-out views reach farther and nearer than the fitted ones. In
fixtures without a fault it is 1.0 to 1.1.
"""
