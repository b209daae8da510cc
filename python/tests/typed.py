"""A program for the type checker."""

import numpy as np
import wayfix
from wayfix.arrow import sequences
from wayfix.evaluate import ThresholdCurve
from wayfix.learning import Family, Learned, learn
from wayfix.matching import Matcher, RoadNetwork
from wayfix.recognition import Mapper, Recognizer

hmm = wayfix.Hmm([0.5, 0.5], np.eye(2), table=[[0.5, 0.5], [0.1, 0.9]])
live: wayfix.Filter = hmm.filter()
surprise: float = live.step(1)
best: int = live.mode
paths: list[wayfix.Path] = hmm.k_best([0, 1], 3)
rows = hmm.smooth([0, 1]).probabilities
print(surprise, best, paths[0].states.sum(), rows.mean(), hmm.score_all([[0], [1, 1]]).sum())

lagging: wayfix.FixedLag = wayfix.FixedLag(hmm, 3)
learned: Learned = learn(hmm, sequences([0, 1]), Family("poisson", rates=[[1.0]]), progress=lambda k, gain: k > 3)
recognizer = Recognizer(np.zeros((3, 4), np.float32), "euclidean", off_map={"leave": 0.01}, speeds=[0, 1], window=2)
place: int | None = recognizer.track().step([0.0, 1.0, 2.0, 3.0], odometry=1.0).place
beliefs = recognizer.fit(np.zeros((9, 4)), [0, 1, 2] * 3).recording(np.zeros((2, 4))).smoothed()
curve = ThresholdCurve.precision_recall(beliefs.probability, beliefs.places == 1)
seen = Mapper(gap=9).step(np.zeros(4))
matcher = Matcher(RoadNetwork.from_path("city.osm.pbf", cleaning=["contraction", ("merging", 30.0)]), noise=8.0)
matched = matcher.match_trips({"time": [0.0], "lat": [0.0], "lon": [0.0]}, estimator="late", lag=3, errors="skip")
metres: float = matcher.start(0, 0, 0).live.metres_along
print(lagging.lagged, learned.family, place, curve.recall_at_precision(1.0), seen, matched.edge.sum(), metres)
