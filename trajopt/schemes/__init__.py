"""Transcriptions of a problem into a nonlinear program, one per file."""

from trajopt.schemes.hermite_simpson import hermite_simpson
from trajopt.schemes.radau import radau
from trajopt.schemes.scheme import Scheme
from trajopt.schemes.trapezoid import trapezoid

__all__ = ["Scheme", "hermite_simpson", "radau", "trapezoid"]
