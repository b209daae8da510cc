"""Matching of GPS points to roads: the roads that a vehicle drove, and the road that it is on now, with their
probabilities.

From a data frame with columns `id`, `time`, `lat`, `lon`, and a network from a file::

    network = RoadNetwork.from_path("city.osm.pbf")       # or .geojson, or a folder with two CSV files
    matcher = Matcher(network)
    matcher = matcher.with_model(**matcher.learn(points, "id").model)     # the accuracy of the receiver

    matched = matcher.match_trips(points, "id")
    matched.points()     # the frame, with the road, the position and the probability of each row
    matched.routes()     # a row for each road driven

Live, `matcher.start(time, lat, lon)` returns a `Vehicle`, which takes one point at a time. Positions are in degrees.
Networks, matchers and vehicles can be pickled; networks and matchers can be shared by threads.
"""

from ._trips import MatchedTrips
from ._wayfix import (
    LearnedMatchModel,
    MatchedDrive,
    Matcher,
    RankedRoutes,
    RoadAnswer,
    RoadAnswers,
    RoadNetwork,
    Stretches,
    Vehicle,
    read_traces,
)

__all__ = [
    "LearnedMatchModel",
    "MatchedDrive",
    "MatchedTrips",
    "Matcher",
    "RankedRoutes",
    "RoadAnswer",
    "RoadAnswers",
    "RoadNetwork",
    "Stretches",
    "Vehicle",
    "read_traces",
]
