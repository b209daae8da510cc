"""Scores of answers: recall, precision and recall by confidence, and calibration of probabilities."""

from ._wayfix import ThresholdCurve, recall_within, reliability

__all__ = ["ThresholdCurve", "recall_within", "reliability"]
