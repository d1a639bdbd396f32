"""The paper's figures and table, made again: `python -m benchmarks.paper`. One file for each."""
