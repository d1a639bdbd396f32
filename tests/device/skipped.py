"""The exit code of checks that this machine cannot run: test harnesses know 77 as a skip."""

SKIPPED = 77
