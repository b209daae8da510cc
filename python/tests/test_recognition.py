"""Place recognition against a small model of it in numpy, and the arrays that it accepts."""

import copy
import pickle
import threading

import numpy as np
import pytest
import wayfix
from wayfix.evaluate import ThresholdCurve, recall_within, reliability
from wayfix.recognition import Mapper, Recognizer

# Only motion at one speed, and the odds of single images.
PLAIN = {
    "closed": True,
    "speeds": {"values": [1.0], "shares": [1.0], "nearby": 0.0, "anywhere": 0.0, "slack": 0.1},
    "lost": {"leave": 1e-30, "back": 0.5, "near": 0.0, "within": 0},
    "odds": {"shares": [0.2, 0.5, 0.3]},
    "standardize": False,
    "use_views": False,
    "view_threshold": 0.0,
}


# Of views of a place that a distracted camera follows.
PHANTOM = np.array([0.3, 0.35, 0.35])


def scores(distances):
    """The score of each place within a row of distances, as the library documents it."""
    centre = np.sort(distances)[len(distances) // 2]
    off = np.abs(distances - centre)
    z = (distances - centre) / (1.4826 * np.sort(off)[len(off) // 2])
    z = np.sign(z) * (np.minimum(np.abs(z), 3) + np.log1p(np.maximum(np.abs(z) - 3, 0)))
    # Around a loop, no reference is nearer than the nearer of its neighbours by more than 1.25.
    return np.maximum(z, np.minimum(np.minimum(np.roll(z, 1), np.roll(z, -1)), 0) - 1.25)


def kinds(z, shares):
    """The odds of each place for a view that says nothing, matches weakly, and matches clearly: their sum counts."""
    z = np.maximum(z, -6)
    return np.array([np.ones_like(z), np.exp(-z / 2 - 1 / 8), np.exp(-3 * z / 2 - 9 / 8)]) * np.c_[shares]


def belief_of_model(rows, moves, phantom_moves, shares, begin, end):
    """Filter and smoother of a vehicle whose camera may follow a phantom, and log-likelihoods of the steps.

    The states are the modes, attentive and distracted, times the places.
    """
    steps, n = rows.shape
    counts, phantom = [10 * np.array(shares), 30 * PHANTOM], np.full(n, 1 / n)
    belief, filtered, transitions, likelihoods, logs = None, [], [], [], []
    for row in rows:
        z = scores(row.astype(float))
        place, other = (kinds(z, count / count.sum()) for count in counts)
        b, q = place.sum(axis=0), other.sum(axis=0)
        begins = continues = q.mean()
        if belief is None:
            before = np.repeat([1 - begin, begin], n) / n
            phantom = q / q.sum()
            b = np.r_[b, np.full(n, begins)]
        else:
            ahead, distracted = phantom @ phantom_moves, belief[n:].sum()
            continues = ahead @ q
            phantom = ((1 - end) * distracted * ahead + begin * (1 - distracted) / n) * q
            phantom /= max(phantom.sum(), 1e-300)
            modes = np.array([[1 - begin, begin * begins], [end, (1 - end) * continues]])
            transitions.append(np.kron(modes, moves))
            before = belief @ transitions[-1]
            b = np.r_[b, np.ones(n)]
        belief = b * before
        logs.append(np.log(belief.sum()))
        belief /= belief.sum()
        filtered.append(belief)
        likelihoods.append(b)
        # Each view counts as of the kinds that it may be of, where the camera may be.
        counts[0] = counts[0] + place / place.sum(axis=0) @ belief[:n]
        counts[1] = counts[1] + other / other.sum(axis=0) @ phantom * belief[n:].sum()
    later, smoothed = np.ones(2 * n), []
    for k in reversed(range(steps)):
        both = filtered[k] * later
        smoothed.append(both / both.sum())
        if k:
            later = transitions[k - 1] @ (likelihoods[k] * later)
            later /= later.sum()
    places = [np.array(of).reshape(steps, 2, n).sum(axis=1) for of in (filtered, smoothed[::-1])]
    return *places, logs


def drive(seed, n=12, steps=30):
    rng = np.random.default_rng(seed)
    truth = (rng.integers(n) + np.arange(steps)) % n
    rows = rng.normal(size=(steps, n))
    rows[np.arange(steps), truth] -= 1.5
    return rows.astype(np.float32), truth


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("begin", [0, 0.1])
def test_model(seed, begin):
    rows, _ = drive(seed)
    steps, n = rows.shape
    options = PLAIN | {"distractions": {"begin": begin, "end": 0.25}}
    recognizer = Recognizer.from_distances(n, **options)
    shares = PLAIN["odds"]["shares"]

    def moves(slack):
        """The distribution of a move, from a place about which the first image leaves no doubt."""
        attentive = recognizer.with_options(distractions={"begin": 0}, speeds={"slack": slack})
        first = attentive.track()
        first.step(np.where(np.arange(n) == 0, 0, np.inf))
        first.predict()
        move = first.places
        assert move[1] == pytest.approx(1 - 2 * slack) and move[0] == pytest.approx(slack)
        return np.array([np.roll(move, place) for place in range(n)])

    # A phantom moves with the usual slack.
    usual = Recognizer.from_distances(n).options["speeds"]["slack"]
    alpha, gamma, logs = belief_of_model(rows, moves(0.1), moves(usual), shares, begin, 0.25)
    recording = recognizer.recording(rows)
    single = np.array([kinds(scores(row.astype(float)), shares).sum(axis=0) for row in rows])
    single /= single.sum(axis=1, keepdims=True)
    found = [
        (recording.filtered(), alpha),
        (recording.smoothed(), gamma),
        (recording.lagged(0), alpha),
        (recording.lagged(steps), gamma),
        (recording.single(), single),
    ]
    for beliefs, expected in found:
        np.testing.assert_allclose(beliefs.probabilities, expected, atol=2e-5)
    np.testing.assert_allclose(recording.filtered().log_likelihoods, logs, atol=2e-5)
    # From similarities, and live.
    track = Recognizer.from_similarities(n, **options).track()
    for k, row in enumerate(rows):
        answer = track.step(-row)
        np.testing.assert_allclose(track.places, alpha[k], atol=2e-5)
    filtered = recording.filtered()
    assert (answer.place, answer.probability) == (filtered.places[-1], filtered.probability[-1])
    assert answer.log_likelihood == filtered.log_likelihoods[-1]
    assert track.log_likelihood == pytest.approx(filtered.log_likelihoods.sum())

    # Answers from the sums over windows, on the loop.
    p = filtered.probabilities
    near = p + np.roll(p, 1, axis=1) + np.roll(p, -1, axis=1)
    np.testing.assert_array_equal(filtered.places, near.argmax(axis=1))
    np.testing.assert_allclose(filtered.probability, near.max(axis=1), atol=1e-12)
    np.testing.assert_allclose(filtered.mass_near(filtered.places, 1), near.max(axis=1), atol=1e-12)
    for k, (first, last) in enumerate(filtered.around):
        inside = np.arange(first, last + 1 + n * (last < first)) % n
        assert p[k, inside].sum() >= 0.9 - 1e-9 or len(inside) == n
    for k in range(steps):
        order = np.argsort(-p[k], kind="stable")
        count = np.searchsorted(np.cumsum(p[k][order]), 0.8) + 1
        np.testing.assert_array_equal(filtered.credible_set(k, 0.8), order[:count])


def images(seed, n=150, d=24, noise=0.7):
    rng = np.random.default_rng(seed)
    references = rng.normal(size=(n, d))
    truth = np.concatenate([np.arange(20, 80), np.full(40, -1), np.arange(90, 140)])
    frames = np.where(truth[:, None] < 0, rng.normal(size=(len(truth), d)), references[truth])
    return references, frames + noise * rng.normal(size=frames.shape), truth


def test_off_the_map_and_fit():
    references, frames, truth = images(3)
    recognizer = Recognizer(references.astype(np.float32), off_map={"leave": 0.01})
    assert recognizer.options["off_map"] == {"leave": 0.01, "back": 0.03, "near": 0.7, "within": 10}
    beliefs = recognizer.recording(frames).smoothed()
    assert beliefs.probabilities.shape == (150, 151)
    assert (beliefs.places == truth).mean() > 0.9
    np.testing.assert_allclose(beliefs.off_map, beliefs.probabilities[:, -1])
    np.testing.assert_allclose(beliefs.mass_near(np.full(150, -1)), beliefs.off_map)
    fitted = recognizer.fit(frames, truth)
    assert fitted.options["off_map"]["leave"] != 0.01
    again = recognizer.with_parameters(fitted.parameters)
    assert again.parameters == fitted.parameters
    np.testing.assert_array_equal(
        again.recording(frames).filtered().probabilities, fitted.recording(frames).filtered().probabilities)
    # Two parts, ranges of places, odometry with a missing reading.
    odometry = np.ones(150)
    odometry[3] = np.nan
    ranges = np.stack([truth, truth], axis=1)
    parts = recognizer.fit(frames, ranges, odometry, lengths=[70, 80])
    assert parts.options["odometry"]["deviation"] != 0.5
    other = parts.with_options(odds={"shares": (0.2, 0.5, 0.3)}, distractions={"end": 0.1}, window=3).options
    assert (other["odds"]["shares"], other["window"]) == ([0.2, 0.5, 0.3], 3)
    assert other["distractions"] == {"begin": 0.003, "end": 0.1}
    assert other["odometry"] == parts.options["odometry"]
    assert recognizer.with_options(off_map=False).options["off_map"] is None
    assert any("fit" in doubt or "labelled" in doubt for doubt in recognizer.fit(frames[:9], truth[:9]).warnings)


@pytest.mark.parametrize("seed", range(4))
def test_a_fit_that_does_harm_is_not_kept(seed):
    references, frames, truth = images(seed)
    recognizer = Recognizer(references, off_map=True)
    fitted = recognizer.fit(frames, truth)
    harm = any("nothing was learned" in doubt for doubt in fitted.warnings)
    assert (fitted.options == recognizer.options) == harm


def test_pickles_and_copies_go_on_to_the_bit():
    references, frames, _ = images(2)
    for recognizer in [
        Recognizer(references, "euclidean", window=2),
        Recognizer.from_traverses([references, references[::-1]], off_map=True),
    ]:
        track = recognizer.track()
        for frame in frames[:30]:
            track.step(frame, 1.0)
        others = [pickle.loads(pickle.dumps(track)), copy.copy(track), copy.deepcopy(track)]
        others.append(recognizer.track_from_bytes(track.to_bytes()))
        for frame in frames[30:60]:
            answer = track.step(frame)
            assert [other.step(frame) for other in others] == [answer] * 4
        again = pickle.loads(pickle.dumps(recognizer))
        assert (again.options, repr(again)) == (recognizer.options, repr(recognizer))
        with pytest.raises(wayfix.Error, match="state of a track"):
            track.restore(b"{")
        assert track.steps == 60


@pytest.mark.parametrize("odometry", [None, np.r_[np.nan, np.ones(59)]])
def test_pickles_of_recordings(odometry):
    references, frames, _ = images(2)
    similarities = frames[:60] @ references.T
    for recognizer, queries in [
        (Recognizer(references, off_map=True), frames[:60]),
        (Recognizer.from_similarities(len(references)), similarities),
    ]:
        recording = recognizer.recording(queries, odometry)
        for again in (pickle.loads(pickle.dumps(recording)), copy.copy(recording), copy.deepcopy(recording)):
            assert len(again) == 60
            np.testing.assert_array_equal(again.smoothed().probabilities, recording.smoothed().probabilities)


@pytest.mark.parametrize("change", [
    lambda a: a.astype(np.float64),
    np.asfortranarray,
    lambda a: np.ascontiguousarray(a[::-1])[::-1],
    lambda a: np.stack([a, a], axis=2)[:, :, 0],
    lambda a: a.tolist(),
    lambda a: np.broadcast_to(a, a.shape),
    lambda a: np.ma.masked_array(a),
])
def test_any_layout(change):
    references, frames, _ = images(3)
    references, frames = references.astype(np.float32), frames.astype(np.float32)
    frames.setflags(write=False)
    expected = Recognizer(references).recording(frames).filtered().probabilities
    found = Recognizer(change(references)).recording(change(frames)).filtered().probabilities
    np.testing.assert_array_equal(found, expected)


REFERENCES = np.random.default_rng(0).normal(size=(20, 4)).astype(np.float32)


@pytest.mark.parametrize(("call", "message"), [
    (lambda r: Recognizer(REFERENCES, clsed=True), "unknown field `clsed`"),
    (lambda r: Recognizer(REFERENCES, window="x"), "options: invalid type"),
    (lambda r: Recognizer(REFERENCES, odds={"shares": [np.float32("nan"), 0.5, 0.5]}), "options"),
    (lambda r: Recognizer(REFERENCES, odds={"shares": [0.5, 0.5, 0.5]}), "sum of the shares of views is 1.5"),
    (lambda r: Recognizer(REFERENCES, distractions={"begin": 2}), "a distraction begins is 2"),
    (lambda r: Recognizer(REFERENCES, speeds=[2, 1]), "speed 1 is 1"),
    (lambda r: Recognizer(REFERENCES, off_map={"leave": 2}), "leaving the map is 2"),
    (lambda r: Recognizer(REFERENCES, "manhattan"), "expected 'cosine' or 'euclidean'"),
    (lambda r: Recognizer(REFERENCES[:0]), "there are no references"),
    (lambda r: Recognizer(REFERENCES[:, :0]), "dimension 0"),
    (lambda r: Recognizer(REFERENCES * np.nan), "element 0 of reference 0 is NaN"),
    (lambda r: Recognizer(REFERENCES.astype(float) * 1e300), "is inf"),
    (lambda r: Recognizer(REFERENCES[0]), "have 1 axes, expected 2"),
    (lambda r: Recognizer(REFERENCES + 0j), "have type complex"),
    (lambda r: Recognizer(["a"]), "have type"),
    (lambda r: Recognizer(np.broadcast_to(np.float32(1), (10**9, 10**9))), "allocate"),
    (lambda r: Recognizer(np.ma.masked_equal([[1.0, 2.0]], 2)), "masked"),
    (lambda r: Recognizer.from_traverses([]), "number of traverses is 0"),
    (lambda r: Recognizer.from_distances(0), "number of references is 0"),
    (lambda r: Recognizer.from_distances(-1), "-1"),
    (lambda r: Recognizer.from_distances(2**62), "32-bit"),
    (lambda r: Recognizer.from_distances(2**70), "1180591620717411303424"),
    (lambda r: r.recording(REFERENCES[:, :3]), "query of step 1"),
    (lambda r: r.recording(np.where(np.arange(20)[:, None] == 7, np.nan, REFERENCES)), "step 8"),
    (lambda r: r.recording(REFERENCES, odometry=[1.0]), "found 1 odometry readings, expected 20"),
    (lambda r: r.recording(REFERENCES, odometry=np.full(20, 1e9)), "step 1"),
    (lambda r: r.track().step(REFERENCES), "have 2 axes"),
    (lambda r: r.track().step(None), "have type object"),
    (lambda r: r.track().step([1.0, 2.0]), "2 elements, expected 4"),
    (lambda r: r.fit(REFERENCES, np.arange(19)), "found 19 places, expected 20"),
    (lambda r: r.fit(REFERENCES, np.arange(20) + 9), "references up to 20"),
    (lambda r: r.fit(REFERENCES, np.full(20, -1)), "0 labelled steps"),
    (lambda r: r.fit(REFERENCES, np.zeros((20, 3), int)), "3 columns"),
    (lambda r: r.fit(REFERENCES, np.arange(20), lengths=[2**64 - 1, 9]), "lengths of parts"),
    (lambda r: r.with_parameters("{}"), "parameters: missing field"),
    (lambda r: r.recording(REFERENCES).filtered().mass_near([20] * 20), "places have 20 at 0"),
    (lambda r: r.recording(REFERENCES).filtered().credible_set(20, 0.5), "no step 20"),
    (lambda r: r.recording(REFERENCES).filtered().credible_set(0, 2), "level is 2"),
    (lambda r: Mapper("cosine", speeds=[]), "at least one state, found none"),
    (lambda r: Mapper().step([np.inf]), "inf"),
    (lambda r: Mapper().recognizer(), "no references"),
    (lambda r: recall_within([1], [1, 2]), "1"),
    (lambda r: ThresholdCurve.precision_recall([0.1, np.nan], [True, False]), "NaN"),
    (lambda r: reliability([2.0], [True]), "2"),
])
def test_hostile_input(call, message):
    with pytest.raises(wayfix.Error, match=message):
        call(Recognizer(REFERENCES))


def test_no_queries():
    beliefs = Recognizer(REFERENCES).recording(REFERENCES[:0]).smoothed()
    assert beliefs.probabilities.shape == (0, 20) and len(beliefs) == 0


def test_an_answer_is_the_middle_of_the_most_probable_window():
    """It is not the most probable place: the place ahead of that is more probable than the one behind."""
    recognizer, rows = Recognizer.from_similarities(30), np.eye(30)[5:20]
    for window in (0, 1, 2):
        found = recognizer.with_options(window=window).recording(rows).filtered()
        np.testing.assert_array_equal(found.probabilities.argmax(axis=1), np.arange(5, 20))
        masses = np.array([np.convolve(row, np.ones(2 * window + 1), "same") for row in found.probabilities])
        np.testing.assert_allclose(found.probability, masses.max(axis=1))
        np.testing.assert_allclose(masses[np.arange(15), found.places], masses.max(axis=1))
    assert recognizer.recording(rows).filtered().places[1] == 7


def test_mapper():
    references, _, _ = images(4)
    mapper, seen = Mapper(gap=20), []
    for step in range(220):
        seen.append(mapper.step(references[step % 150]))
    assert all(answer is None for answer in seen[:150])
    places = [answer.place for answer in seen[170:] if answer is not None]
    assert len(places) > 30 and abs(places[-1] - 69) <= 1
    np.testing.assert_array_equal(mapper.references[:150], references.astype(np.float32))
    later = pickle.loads(pickle.dumps(mapper.recognizer(window=2)))
    assert later.references == len(copy.copy(mapper).references)
    again = pickle.loads(pickle.dumps(mapper))
    for step in range(70, 150):
        answer, expected = again.step(references[step]), mapper.step(references[step])
        assert (answer is None) == (expected is None)
        assert answer is None or (answer.place, answer.probability) == (expected.place, expected.probability)
    np.testing.assert_array_equal(again.references, mapper.references)
    with pytest.raises(ValueError, match="version"):
        Mapper._from_parts("{}")


def test_scores_against_numpy():
    rng = np.random.default_rng(5)
    confidence, right = rng.random(300).round(2), rng.random(300) < 0.6
    curve = ThresholdCurve.precision_recall(confidence, right, 250)
    at = [confidence >= threshold for threshold in curve.thresholds]
    np.testing.assert_allclose(curve.precision, [right[above].mean() for above in at])
    np.testing.assert_allclose(curve.recall, [right[above].sum() / 250 for above in at])
    best = max([r for p, r in zip(curve.precision, curve.recall, strict=True) if p >= 0.7], default=0)
    assert curve.recall_at_precision(0.7) == best
    pairs = confidence[right][:, None] - confidence[~right]
    area = (np.sign(pairs) / 2 + 0.5).mean()
    assert ThresholdCurve.roc(confidence, right).area == pytest.approx(area)
    bins = reliability(confidence, right, 5)
    cells = np.minimum((confidence * 5).astype(int), 4)
    np.testing.assert_allclose(bins["fraction_true"], [right[cells == c].mean() for c in range(5)])
    gaps = [abs(right[cells == c].mean() - confidence[cells == c].mean()) for c in range(5)]
    shares = np.bincount(cells) / 300
    assert bins["expected_calibration_error"] == pytest.approx((shares * gaps).sum())
    assert recall_within([[3, 5], [9, 9], [-1, -1]], [6, 30, 7], 1) == 0.5


def test_the_lock_is_released():
    rng = np.random.default_rng(0)
    recognizer = Recognizer(rng.normal(size=(1000, 32)))
    frames, done, ticks = rng.normal(size=(100, 32)), threading.Event(), 0

    def work():
        recognizer.recording(frames).smoothed()
        done.set()

    thread = threading.Thread(target=work)
    thread.start()
    while not done.wait(0.001):
        ticks += 1
    thread.join()
    assert ticks > 3


def test_threads_share_a_track():
    track, errors = Recognizer(REFERENCES).track(), []

    def work():
        try:
            for row in REFERENCES:
                track.step(row)
                assert track.places.sum() == pytest.approx(1)
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors and track.steps == 4 * len(REFERENCES)


@pytest.mark.parametrize("call", ["recording", "smoothed", "fit"])
def test_interrupt(call, interrupted):
    rng = np.random.default_rng(0)
    recognizer = Recognizer(rng.normal(size=(3000, 64)))
    frames = rng.normal(size=(700 if call == "smoothed" else 3000, 64))
    recording = recognizer.recording(frames[:700])
    interrupted({
        "recording": lambda: [recognizer.recording(frames) for _ in range(50)],
        "smoothed": lambda: [recording.smoothed() for _ in range(50)],
        "fit": lambda: [recognizer.fit(frames[:1500], np.arange(1500)) for _ in range(50)],
    }[call], goes_on=call == "smoothed")
