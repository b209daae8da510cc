"""wayfix in four parts: weather, hmmlearn's models, places on a route by their images, and GPS on roads.

Run it as a whole (pictures go to the folder given as its argument, or `tutorial`), or cell by cell in an editor that
knows `# %%`. Needs matplotlib and scikit-learn, and pandas for the last part.
"""

# %% Preparation
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

# In an editor, `sys.argv` holds the editor's arguments.
OUT = Path(sys.argv[1] if len(sys.argv) == 2 and not sys.argv[1].startswith("-") else "tutorial")
OUT.mkdir(parents=True, exist_ok=True)

# The palette of Okabe and Ito, which colour-blind readers can tell apart.
BLUE, ORANGE, GREEN, PURPLE, GREY = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#999999"
plt.rcParams.update({"figure.dpi": 110, "font.size": 10, "axes.spines.top": False, "axes.spines.right": False})


def save(figure, name):
    figure.savefig(OUT / name)
    plt.close(figure)
    print("drew", OUT / name)


# %% Weather: a model in ten lines
import wayfix

# Sun or rain, behind the curtain. A guest brings an umbrella (1) or does not (0).
weather = wayfix.Hmm(start=[0.5, 0.5], moves=[[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
umbrellas = [0, 0, 1, 0, 0, 1, 1, 1, 0, 1, 1, 0, 0, 0]
live = weather.forward(umbrellas).probabilities[:, 1]         # as known on the day
afterwards = weather.smooth(umbrellas).probabilities[:, 1]    # as known at the end
path = weather.viterbi(umbrellas).states                      # the most probable story

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
days = np.arange(1, len(umbrellas) + 1)
axes.fill_between(days, path, step="mid", color=GREY, alpha=0.25, label="rain in the most probable story")
axes.plot(days, live, "o--", color=ORANGE, label="that day")
axes.plot(days, afterwards, "s-", color=BLUE, label="in the end")
axes.plot(days[np.array(umbrellas) == 1], np.full(sum(umbrellas), 1.06), "v", color="black", label="umbrella")
axes.set(xlabel="day", ylabel="probability of rain", ylim=(0, 1.12), xticks=days[::2])
figure.legend(loc="outside right center", frameon=False)
save(figure, "weather.png")

# %% hmmlearn's models: one import changes
from wayfix.hmmlearn import hmm  # was: from hmmlearn import hmm

rng = np.random.default_rng(1)
regime = np.repeat([0, 1, 0, 1, 0], [120, 60, 150, 40, 80])
returns = np.where(regime == 0, rng.normal(0.05, 0.5, len(regime)), rng.normal(-0.1, 1.8, len(regime)))[:, None]
model = hmm.GaussianHMM(n_components=2, random_state=0, n_iter=100).fit(returns)
wild = int(np.argmax(model.covars_.ravel()))
probability = model.predict_proba(returns)[:, wild]
share = np.mean((probability > 0.5) == (regime == 1))
print(f"volatilities {np.sqrt(model.covars_.ravel()).round(2)}, {share:.0%} right")

figure, (top, bottom) = plt.subplots(2, figsize=(7, 4), sharex=True, layout="constrained")
top.plot(returns, color=GREY, linewidth=0.8)
top.set(ylabel="return, %")
bottom.fill_between(np.arange(len(regime)), regime, step="mid", color=GREY, alpha=0.3, label="truth")
bottom.plot(probability, color=BLUE, label="smoothed")
bottom.set(xlabel="day", ylabel="probability of\nthe wild regime", ylim=(0, 1.02))
figure.legend(loc="outside upper right", ncols=2, frameon=False)
save(figure, "regimes.png")

# %% Places on a route by their images
from wayfix.evaluate import ThresholdCurve, recall_within
from wayfix.recognition import Recognizer

# A route of 300 references, driven again in another season, with a stop and a detour. Real descriptors would come from a
# neural network, in two files: np.load("references.npy"), np.load("queries.npy").
parts = [np.arange(20, 110), np.full(25, 110), np.arange(110, 170), np.full(40, -1), np.arange(200, 280)]
truth = np.concatenate(parts)
smooth = np.exp(-0.5 * (np.arange(-8, 9) / 2.0) ** 2)


def drive(noise, seed):
    rng = np.random.default_rng(seed)
    views = np.apply_along_axis(np.convolve, 0, rng.normal(size=(300, 64)), smooth, "same") / np.sqrt((smooth**2).sum())
    elsewhere = np.apply_along_axis(np.convolve, 0, rng.normal(size=(len(truth), 64)), smooth, "same") / 4
    season = rng.normal(size=64)
    seen = np.where(truth[:, None] < 0, elsewhere, views[truth])
    queries = seen + 0.5 * season + noise * rng.normal(size=seen.shape)
    return views.astype(np.float32), queries.astype(np.float32)


def cosine(queries, references):
    unit = [rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in (queries, references)]
    return unit[0] @ unit[1].T


def judged(noise, seed):
    """Returns beliefs, and for each method recall within two references, recall at 100 % precision, and the curve."""
    references, queries = drive(noise, seed)
    recording = Recognizer(references, off_map=True).recording(queries)   # the vehicle may leave the route
    filtered, smoothed = recording.filtered(), recording.smoothed()
    similarity = cosine(queries, references)
    found = {}
    for name, places, confidence in [
        ("nearest image", similarity.argmax(axis=1), similarity.max(axis=1)),   # which is never off the map
        ("filter", filtered.places, filtered.probability),
        ("smoother", smoothed.places, smoothed.probability),
    ]:
        # An answer is right within two references, or if both it and the truth are off the map.
        right = (np.abs(places - truth) <= 2) & ((places < 0) == (truth < 0))
        curve = ThresholdCurve.precision_recall(confidence, right)
        found[name] = recall_within(truth, places, 2), curve.recall_at_precision(1.0), curve
    return recording, smoothed, similarity, found


# With a noise of 2.6, single images say little, and a filter helps. The noise was 1.6 at first, and the nearest image
# then beat the filter in recall at 100 % precision, 0.40 to 0.17. So several noises are compared below.
recording, smoothed, similarity, found = judged(noise=2.6, seed=2)
print("warnings:", recording.warnings() or "none")
for name, (within, sure, _) in found.items():
    print(f"{name}: recall within 2 {within:.2f}, at 100 % precision {sure:.2f}")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained", width_ratios=[1.3, 1])
image = left.imshow(similarity.T, origin="lower", aspect="auto", cmap="Greys", interpolation="nearest")
steps = np.arange(len(truth))
on_map = smoothed.places >= 0
left.plot(steps[truth >= 0], truth[truth >= 0], ".", color=ORANGE, markersize=7, label="truth")
left.plot(steps[on_map], smoothed.places[on_map], ".", color=BLUE, markersize=2.5, label="smoother")
left.fill_between(steps, 0, 300, where=~on_map, step="mid", color=PURPLE, alpha=0.35, label="off the map")
left.set(xlabel="query", ylabel="reference", ylim=(0, 300))
left.legend(loc="upper left", frameon=True, framealpha=0.9)
figure.colorbar(image, ax=left, label="cosine similarity")
STYLES = [(GREY, ":"), (ORANGE, "--"), (BLUE, "-")]
for (name, (_, sure, curve)), (color, style) in zip(found.items(), STYLES, strict=True):
    label = f"{name}: {sure:.2f}"
    right.plot(curve.recall, curve.precision, style, color=color, linewidth=2, label=label)
right.set(xlabel="recall", ylabel="precision", xlim=(0, 1.02), ylim=(0, 1.05))
right.legend(title="recall at 100 % precision", loc="lower left", frameon=False)
save(figure, "places.png")

# %% Which of them wins at which noise: means and extremes of ten drives each
NOISES, SEEDS = [0.8, 1.2, 1.6, 2.0, 2.6, 3.2], range(2, 12)
scores = np.array([[[[*of[:2]] for of in judged(noise, seed)[3].values()] for seed in SEEDS] for noise in NOISES])
print("noise  recall within 2             recall at 100 % precision")
print("       nearest  filter  smoother   nearest  filter  smoother")
for noise, means in zip(NOISES, scores.mean(axis=1), strict=True):
    print(f"{noise:5}  " + "   ".join("  ".join(f"{value:7.2f}" for value in column) for column in means.T))

figure, both = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained", sharey=True)
for number, (axes, title) in enumerate(zip(both, ["recall within 2", "recall at 100 % precision"], strict=True)):
    for values, name, (color, style) in zip(scores[..., number].transpose(2, 0, 1), found, STYLES, strict=True):
        axes.fill_between(NOISES, values.min(axis=1), values.max(axis=1), color=color, alpha=0.2, linewidth=0)
        axes.plot(NOISES, values.mean(axis=1), style, color=color, linewidth=2, label=name)
    axes.set(xlabel="noise of a query", title=title, ylim=(0, 1.02))
both[0].legend(loc="lower left", frameon=False)
save(figure, "noises.png")

# %% GPS on roads
import pandas as pd

from wayfix.matching import Matcher, RoadNetwork

# A town of 6 by 6 crossings, 120 m apart; yours comes from RoadNetwork.from_path("city.osm.pbf").
LAT, LON, DEGREE = 50.0, 10.0, 111_195.0
crossing = [(row, column) for row in range(6) for column in range(6)]
nodes = pd.DataFrame({
    "node": [10 * row + column for row, column in crossing],
    "lat": [LAT + 120 * row / DEGREE for row, _ in crossing],
    "lon": [LON + 120 * column / DEGREE / np.cos(np.radians(LAT)) for _, column in crossing],
})
ends = [(a, b) for a in nodes["node"] for b in (a + 1, a + 10) if b in set(nodes["node"])]
edges = pd.DataFrame(ends, columns=["from", "to"]).assign(oneway="no", speed_kmh=50)
matcher = Matcher(RoadNetwork(nodes, edges))

# Two vehicles with a point every three seconds; errors of a receiver last for a while.
def trip(name, stops, seed):
    rng = np.random.default_rng(seed)
    corners = np.array([(stop % 10, stop // 10) for stop in stops]) * 120.0
    lengths = np.r_[0, np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1))]
    along = np.arange(0, lengths[-1], 33.0)
    x, y = (np.interp(along, lengths, corners[:, axis]) for axis in (0, 1))
    error = np.zeros((len(along), 2))
    for k in range(1, len(along)):
        error[k] = 0.95 * error[k - 1] + rng.normal(scale=4.0, size=2)
    x, y = x + error[:, 0], y + error[:, 1]
    time = pd.Timestamp("2024-05-01 08:00") + pd.to_timedelta(3 * np.arange(len(x)), "s")
    lat, lon = LAT + y / DEGREE, LON + x / DEGREE / np.cos(np.radians(LAT))
    return pd.DataFrame({"id": name, "time": time, "lat": lat, "lon": lon})


points = pd.concat([trip("van", [0, 3, 33, 31, 51, 55], 3), trip("bus", [50, 20, 24, 44], 4)], ignore_index=True)
matched = matcher.match_trips(points, "id")
answers, routes = matched.points(), matched.routes()
print(answers[["id", "time", "from", "to", "metres_along", "probability"]].head(3).to_string(index=False))
print(routes.groupby("id")["edge"].count().rename("roads driven").to_string())
now = matcher.match_trips(points, "id", estimator="live")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained", width_ratios=[1.1, 1])
for edge in range(len(matcher.network.edges["from"])):
    lat, lon = matcher.network.shape(edge).T
    left.plot(lon, lat, color="#dddddd", linewidth=5, solid_capstyle="round", zorder=1)
for name, color, marker in [("van", BLUE, "o"), ("bus", ORANGE, "s")]:
    own = answers["id"] == name
    lat, lon = matcher.match_drive(points[own]).route.line().T
    left.plot(lon, lat, color=color, linewidth=2, label=f"{name}: route", zorder=2)
    left.plot(points["lon"][own], points["lat"][own], marker, color=color, markersize=4, markeredgecolor="black",
              markeredgewidth=0.5, linestyle="none", label=f"{name}: points", zorder=3)
    seconds = (points["time"][own] - points["time"].min()).dt.total_seconds()
    right.plot(seconds, now.probability[own], ":", color=color, label=f"{name}: live")
    right.plot(seconds, matched.probability[own], "-", color=color, label=f"{name}: afterwards")
left.set(xlabel="longitude", ylabel="latitude", aspect=1 / np.cos(np.radians(LAT)))
left.ticklabel_format(useOffset=False)
left.xaxis.set_major_locator(plt.MaxNLocator(4))
left.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=2, frameon=False)
right.set(xlabel="seconds", ylabel="probability of the road", ylim=(0, 1.02))
right.legend(loc="lower right", frameon=False)
save(figure, "roads.png")
