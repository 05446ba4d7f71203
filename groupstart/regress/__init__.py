"""Regression of jobs on machines: run a suite, compare with baselines that people can read, tell what changed where."""
