"""Feedback laws that hold a gait."""

from trajopt.feedback.lqr import LimitCycleLqr

__all__ = ["LimitCycleLqr"]
