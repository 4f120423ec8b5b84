"""A page that people pass on: the front, a policy and a wheel to drive, in one HTML file."""
