"""Feedback laws that hold a gait: one per file in `trajopt.feedback.laws`, parts beside it."""

from trajopt.feedback.law import Controller, Law

__all__ = ["Controller", "Law"]
