"""The thresholds of the checks with their reasons, shown to readers in docs/verdict-checks.md."""

STATIONARY = 0.3
"""Standard deviations from the optimum, within which a fit that ended early has converged for all
that its sigma says: with that error beside it, sigma would be 4 % larger. Flat valleys of numbers
that are hardly known use up the steps 0.01 to 0.13 before the end.
"""

SMALLEST_BOARD = 1e-3
"""m, the width of a board: the smallest targets of microscopes have as much."""
LARGEST_BOARD = 10.0
"""m: no board is as wide, so its size is in another unit than declared."""
SMALL_BOARD = 0.04
"""m: the width of a board below which its unit is doubted: boards of centimetres are wider."""
TINY = 0.5
"""Width of a board over the radius of its cover, below which its unit is wrong: a board of a few
centimetres before a dome is smaller than the dome, but not by half.
"""
UNSURE_SQUARE = 0.01
"""Relative standard deviation of the squares' declared side: a ruler over several squares tells
them to some permille, and a length that is off by more than a per cent is no measurement.
"""

WORSE_THAN_BARE = 1.5
"""Cover stage over pinhole stage: a cover that is described well lowers the error, and one of thin
glass hardly changes it.
"""
REFUTED = 1.03
"""Fitted cover over the camera alone, each with a lens that was fitted to the pictures. A cover
that is not visible leaves the same error to a permille. A cone for a dome in water left 1.04.
"""
NO_BETTER = 0.95
"""Fit with a cover over pinhole stage, from which the cover explains nothing: pictures without the
cover that declared one left 1.03, and the weakest cover of 22 drawn sessions 0.87.
"""
EXPLAINED = 3.0
"""Pinhole stage over the corners' noise, up to where the camera alone explains them: a lens that
was found through the cover leaves little more than noise, for what it cannot have is how the cover
acts with depth; one that was found without it, a multiple (tests/verdict/test_bare_pictures.py has
covers of one and three millimetres).
"""
TAKEN_UP = 10.0
"""Cover stage over final stage with every number held: uneven glass alone (`fixtures/bumps`, 11 um
of it) makes 6 of it, a thickness, focal length or principal point that is wrong 10 to 22.
"""
ASKING_ORIENTATION = 1.5
"""Cover stage over final stage, from where on other orientations are tried: below, the cover as it
is described leaves too little for one that is mirrored or turned.
"""
OTHER_ORIENTATION = 1 / 3
"""Cover stage of pictures that are put right over that of the pictures as they are. Numbers that
were off by their tolerances made it less than a half in one of a hundred sessions; pictures that
are turned make it a tenth.
"""
OTHER_MEDIUM = 0.5
"""Cover stage with air for water, or water for air, over the declared one: a third of the index
more changes the bending of every ray by more than any other number can, so that a medium that is
right halves the error at least.
"""
OTHER_MEDIUM_LOG_ODDS = 7.0
"""The log odds of the other medium that are a reason, where other numbers are unknown: a thousand
to one. Of the rendered fixtures in air none is above 0. Those in water, declared as in air, have
129 and more with an unknown thickness; 236 and 346 with an unknown lens, but a dome 0; and with
every number unknown, 10 behind a window and below 0 behind a dome or cone, where air explains them
as well (`python -m benchmarks.unknown --media`).
"""
SAME_INDEX = 0.02
"""The difference from the index of water below which the glass's index is doubted: covers are of
acrylic, 1.49, and above. Films of fluoropolymer, 1.34, are the exception, and their fit holds.
"""
SQUARE_PIXELS = 2e-3
"""The least relative difference of fx and fy that is a reason: 31 measured sets have 1.4 permille
in the median after a diagnosis, 2.8 before.
"""
SQUARE_SIGMAS = 4.0
"""Standard deviations by views that this difference must have."""
SCATTER = 2.0
"""The scatter of views or board corners over that of noise: clean sessions have up to 1.4, the
fixtures that hide an effect 5 to 7.
"""

SCORED = 1e-3
"""Chance of an effect's score, over all that are asked: one good calibration in a thousand is
doubted for it.
"""
AGREED = 0.01
"""p-value of the views' agreement on an effect. An effect that the glass imitates well is told by
few of them: 0.0015 in `fixtures/stretch`.
"""
WORTH_NAMING = 0.01
"""The smallest promised decrease of the error beyond chance: the least that the diagnosis accepts.
Rendered sessions that hide nothing have 0.004 at most.
"""
NAMED_BESIDE = 0.5
"""Relative to the best promise: other effects that promise more may be the cause as well."""
MOST_NAMED = 3
BEYOND_NOISE = 2.0
"""Error over the corners' noise.

Noise is known to some per cent, and what views' poses take up of it is less than that.
"""

BESIDE_UNSEEN = 5
"""Views that show the last row but one of a board with markers, where none shows the last: a board
that reaches out of the picture in each of so many, and on the same side of itself, was hardly
moved.
"""

FEW_CELLS = 0.5
"""The smallest fraction of the image's cells with corners: fewer leave more than half of the
picture to extrapolation.
"""
ONE_DEPTH = 1.5
"""Farthest over nearest corner.

Lens and cover are told apart by what changes with depth; from 1 to 1.5 m, a third of the parallax
does.
"""
UNSURE = 0.5
"""px, predicted standard deviation of the maps at the corners: from there a map is known to less
than a pixel.
"""
UNSURE_FOCAL = 0.01
"""Standard deviation of the focal length over it: distances that are measured with it are off by as
much.
"""
NOTICED_SCALE = 0.003
"""Relative change of the scale of depth and length, from where on held numbers that the views
contradict are named: a third of UNSURE_FOCAL, at which three standard deviations are that. Rendered
sessions with a bent board, a rolling shutter or a stretched print change it by 0.0011 at most.
"""
UNBOUNDED_SCALE = 0.1
"""The scale's standard deviation by the views alone, above which no figure is given: most of it is
then the width that a declared focal length is given.
"""
DOMINANT = 0.5
"""The fraction of the scale's variance or change from which a number is named."""
TELLS = 2
"""Unknowns of camera and glass that one view of a flat board tells, its pose aside: a homography
has eight numbers, six are the pose's (Z. Zhang, A flexible new technique for camera calibration,
2000).
"""
FIGURE_UNKNOWNS = 15
"""Polynomials up to the fourth degree: what the relief's prior leaves free."""

CROPPED = 1.0
"""Sizes of the picture between its middle and the principal point. Beyond half of one it lies
outside of the picture, which a mode that reads out a corner of the sensor may do; beyond a whole
one, no such mode of a camera is known.
"""
SAME_SIZE = 0.06
"""The relative difference between twice the principal point and a sensor mode's size: three
standard deviations of how far lenses are mounted off the middle, 20 px of 1000.
"""
OTHER_SIZE = 0.15
"""The same between twice the principal point and the picture's size, from where on it is asked
whether another mode fits.
"""
FIELD = (0.3, 6.0)
"""Focal length over the picture's width, from a lens of 118 degrees to one of 10: the pinhole
cameras that look through covers.
"""

INSIDE = 1.2
"""Median distance of the corners from the pinhole over that of the glass: nearer, the board would
touch the cover when it is tilted.
"""
REACHED_GLASS = 0.01
"""The fraction of the corners that may seem to be inside the cover: a board may touch
it, and the estimate may be a little off.
"""
FAR_AWAY = 1000.0
"""The same: a board that fills a part of the picture 40 m away from a cover of 40 mm is as large as
a house.
"""
SMALL_RADIUS = 0.01
"""m: covers are made for cameras, of which few fit behind 10 mm. Centimetres that are written for
millimetres make 2.5 to 10 mm of domes and tubes of 25 to 100.
"""
THIN_COVER = 0.0005
"""m: the thinnest glass of a cover that is not flat, which may be a film."""
SMALL_COVER = 0.02
"""m: the distance of a cover that FAR_AWAY counts with at least; a window right before the lens
says nothing of boards.
"""

HELD_OUT_ELSEWHERE = 10.0
"""Held-out over fitted error of pictures of another camera, cover or board: they have 20 and more.
"""
MIN_ELSEWHERE = 0.5
"""px: smaller errors do no harm, whatever the ratio."""
HELD_OUT = 1.5
"""Held-out over fitted error. Held-out views reach farther and nearer than the fitted ones; those
of the fixtures have 1.0 to 1.1 times their error where nothing is wrong.
"""
