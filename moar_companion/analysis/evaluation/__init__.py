"""The paper's experiments (Section V), rerun: pure sweeps, their measures, figures and report."""
