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
"""

from ._wayfix import Answer, Mapper, PlaceBeliefs, Recognizer, Recording, Track

__all__ = ["Answer", "Mapper", "PlaceBeliefs", "Recognizer", "Recording", "Track"]
