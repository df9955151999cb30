"""The figures of the evaluation, after those of the paper."""
