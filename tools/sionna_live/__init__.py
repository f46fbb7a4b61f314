"""corf and Sionna RT on the same scene: export, trace, compare, report."""
