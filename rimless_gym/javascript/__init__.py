"""The simulator for browsers: the equations printed as JavaScript, and a stepper around them."""
