"""Place recognition by images: from descriptors or similarities to the vehicle's place on a route, with its
probability, live and afterwards.

Two files and ten lines::

    references, queries = np.load("references.npy"), np.load("queries.npy")   # (n, d) and (steps, d)
    recognizer = Recognizer(references)
    beliefs = recognizer.recording(queries).smoothed()      # or filtered(), as it would be live
    beliefs.places, beliefs.probability                     # an answer for each query

    right = abs(beliefs.places - truth) <= 2
    curve = ThresholdCurve.precision_recall(beliefs.probability, right)   # wayfix.evaluate
    curve.recall_at_precision(1.0)

For a matrix of similarities, `Recognizer.from_similarities(n)` takes its rows as queries. If `metres` has the
coordinates of the references, an answer in metres is `metres[beliefs.places]`.

Options
-------
closed : bool
    True if the references form a loop.
speeds : list, or dict of values, shares, nearby, anywhere, slack
    Speeds in references per step (-2 to 3), the share of time at each, the probabilities of a change to a
    neighbouring speed (0.01) and to any speed (0.005), and those of one place more and of one less (0.04 each).
odometry : dict of scale, bias, deviation
    Readings, in references: the reading for each reference driven (1), the reading while standing (0), and the
    standard deviation (0.5).
off_map : bool, or dict of leave, back, near, within
    Probabilities per step of leaving the route and of coming back, and the probability `near` of coming back within
    `within` references of the place where the vehicle left.
lost : dict of leave, back, near, within
    Rates of losing the vehicle and of finding it at any place, for a route without `off_map`: so a place that a
    tunnel ruled out can come back. Answers are those of a vehicle that is not lost.
distractions : dict of begin, end
    Probabilities per step that the camera begins to follow another place than the vehicle's, or to say nothing
    (0.003), and that this ends (0.05): snow or a street like another one is one error, not as many as it has frames.
odds : dict of shares
    Shares of the views that say nothing, match weakly, and match clearly, before the first (0.1, 0.45, 0.45). They
    count as ten views; the shares of a drive are learned from it.
standardize : bool
    True if the usual scores of each reference are learned from the queries, so that a reference that resembles
    everything does not win (True).
use_views, views : bool, and dict of standing, moved
    True if a change of view is evidence of moving (True), and the probabilities of an unchanged view while standing
    (0.9) and while moving (0.05).
view_fades, view_threshold : float
    Rate at which runs of such evidence lose weight (0.1), and the smallest change that counts as a new view, in units
    of the change from one reference to the next (0.05).
window : int
    Number of references on either side that count as the same place (1).
"""

from ._wayfix import Answer, Mapper, PlaceBeliefs, Recognizer, Recording, Track

__all__ = ["Answer", "Mapper", "PlaceBeliefs", "Recognizer", "Recording", "Track"]
