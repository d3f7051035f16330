"""Two minutes with a real robot: what its link, sensors and motors are, beside its twin."""
