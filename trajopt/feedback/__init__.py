"""Feedback laws that hold a gait: `trajopt.feedback.laws` has one per file, the rest is for them."""

from trajopt.feedback.law import Controller
from trajopt.feedback.laws.lqr import LimitCycleLqr

__all__ = ["Controller", "LimitCycleLqr"]
