"""Streaming: the present of a delayed camera, predicted frame by frame in bounded memory."""

from geovp_classic.streaming.commands import Command
from geovp_classic.streaming.live import LivePredictor, LiveView, PushReport
from geovp_classic.streaming.settings import LiveSettings

__all__ = ["Command", "LivePredictor", "LiveSettings", "LiveView", "PushReport"]
