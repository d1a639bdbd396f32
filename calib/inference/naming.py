"""Thresholds for the name of a cause, shared by the diagnosis and the check of later pictures."""

NAME_ALONE = 0.95
"""The smallest probability at which a name stands alone."""
MIN_MEMBER_PROBABILITY = 0.01
"""The smallest probability of a family's member that is reported."""
