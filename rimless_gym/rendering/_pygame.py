"""pygame without the greeting it prints, which would end up in scripts' JSON output."""

import os

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame

__all__ = ["pygame"]
