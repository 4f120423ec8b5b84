"""Feedback laws that hold a gait: one per file in `trajopt.feedback.laws`, parts beside it."""

from trajopt.feedback.law import Controller
from trajopt.feedback.laws.lqr import LimitCycleLqr

__all__ = ["Controller", "LimitCycleLqr"]
