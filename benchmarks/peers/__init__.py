"""Other calibrations on the same corners: `python -m benchmarks.peers`. One file for each peer, run
in a process of its own.

`case`, `child`, `central` and `mrcal` run under Debian's own Python too, which has numpy, scipy and
mrcal, and no torch.
"""
