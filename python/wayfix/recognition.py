"""Place recognition by images: from descriptors or similarities to the place of a route that the
vehicle is at, with its probability, live and afterwards.

Two files and ten lines::

    references, queries = np.load("references.npy"), np.load("queries.npy")   # (n, d) and (steps, d)
    recognizer = Recognizer(references)
    beliefs = recognizer.recording(queries).smoothed()      # or filtered(): what is known live
    beliefs.places, beliefs.probability                     # an answer for each query

    right = abs(beliefs.places - truth) <= 2
    curve = ThresholdCurve.precision_recall(beliefs.probability, right)   # wayfix.evaluate
    curve.recall_at_precision(1.0)

For a matrix of similarities, `Recognizer.from_similarities(n)` takes its rows as queries. In metres, an
answer is `metres[beliefs.places]`, with the coordinates of the references.

Options
-------
closed : bool
    True if the references form a loop.
speeds : list, or dict of values, shares, nearby, anywhere, slack
    Speeds in references a step (-2 to 3), the share of time at each, the probabilities of a change to a
    neighbouring speed (0.01) and to any (0.005), and that of one place more, and of one less (0.04).
odometry : dict of scale, bias, deviation
    Readings, in references: how many for each one driven (1), how many while standing (0), and their error
    (0.5).
off_map : bool, or dict of leave, back, near, within
    Probabilities, in a step, of leaving the route and of coming back, and that of coming back within so many
    references of where it left.
off_map_odds : float
    Odds of being off the map at each step, against those of a wrong place (0.85): at 1, dark stretches are
    taken for off the map, at 0.75 detours are found late.
lost : dict of leave, back, near, within
    Rates of losing the vehicle and of finding it at any place, without `off_map`: a place that was ruled out by a
    tunnel comes back. Answers are those of a vehicle that is not lost.
lost_odds : float
    Odds of being lost at each step, against those of a wrong place (0.6).
odds : dict of slope, even, nothing, temperature
    Odds that a reference is the right one by its score in standard deviations: how fast they rise (2), where
    they are even (-1.15), the probability that a frame says nothing (0.05), and the temperature (1.8), above 1
    since frames in sequence err together: a higher one makes answers less sure. `fit` chooses another where
    labels are in favour of it.
standardize : bool
    True if the usual scores of each reference are learned from the queries, so that one that looks like
    everything does not win (True).
use_views, views : bool, and dict of standing, moved
    True if a view that changes is evidence of moving (True), and the probabilities of one that does not change while
    standing (0.9) and moving (0.05).
view_fades, view_threshold : float
    Rate at which runs of such evidence lose weight (0.1), and the least change that is a new view, in units of the
    change from a reference to the next (0.1).
window : int
    Number of references on either side that count as the same place (1).
"""

from ._wayfix import Answer, Mapper, PlaceBeliefs, Recognizer, Recording, Track

__all__ = ["Answer", "Mapper", "PlaceBeliefs", "Recognizer", "Recording", "Track"]
