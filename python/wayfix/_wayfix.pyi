"""Types of the compiled part."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._learning import Family as Family, FixedLag as FixedLag, Learned as Learned, learn as learn
from ._matching import LearnedMatchModel as LearnedMatchModel, MatchedDrive as MatchedDrive
from ._matching import Matcher as Matcher, RankedRoutes as RankedRoutes, RoadAnswer as RoadAnswer
from ._matching import RoadAnswers as RoadAnswers, RoadNetwork as RoadNetwork
from ._matching import Stretches as Stretches, Vehicle as Vehicle, read_traces as read_traces
from ._recognition import Answer as Answer, Mapper as Mapper, PlaceBeliefs as PlaceBeliefs
from ._recognition import Recognizer as Recognizer, Recording as Recording, Track as Track
from ._recognition import ThresholdCurve as ThresholdCurve
from ._recognition import recall_within as recall_within, reliability as reliability

__version__: str

class Error(ValueError):
    step: int | None
    sequence: int | None

class ImpossibleError(Error): ...

@final
class Smoothed:
    def __new__(cls, probabilities: ArrayLike, log_likelihood: float) -> Smoothed: ...
    @property
    def probabilities(self) -> NDArray[np.float64]: ...
    @property
    def log_likelihood(self) -> float: ...

@final
class Path:
    def __new__(cls, states: ArrayLike, log_probability: float) -> Path: ...
    @property
    def states(self) -> NDArray[np.int64]: ...
    @property
    def log_probability(self) -> float: ...

@final
class Filter:
    def step(self, observation: ArrayLike) -> float: ...
    def update(self, observation: ArrayLike) -> float: ...
    def predict(self) -> None: ...
    def restart(self) -> None: ...
    @property
    def belief(self) -> NDArray[np.float64]: ...
    @property
    def mode(self) -> int: ...
    @property
    def steps(self) -> int: ...
    @property
    def log_likelihood(self) -> float: ...
    def to_bytes(self) -> bytes: ...
    def restore(self, bytes: bytes) -> None: ...
    def __copy__(self) -> Filter: ...
    def __deepcopy__(self, _memo: Any) -> Filter: ...

@final
class Hmm:
    def __new__(
        cls,
        start: ArrayLike,
        moves: Any,
        *,
        table: ArrayLike | None = None,
        logarithms: bool = False,
        start_before_move: bool = False,
    ) -> Hmm: ...
    @property
    def states(self) -> int: ...
    def score(self, observations: ArrayLike) -> float: ...
    def smooth(self, observations: ArrayLike) -> Smoothed: ...
    def forward(self, observations: ArrayLike) -> Smoothed: ...
    def viterbi(self, observations: ArrayLike) -> Path: ...
    def k_best(self, observations: ArrayLike, count: int) -> list[Path]: ...
    def score_all(
        self,
        sequences: Iterable[ArrayLike] | ArrayLike,
        lengths: ArrayLike | None = None,
        *,
        n_jobs: int = 1,
        progress: Callable[[int, int], object] | None = None,
    ) -> NDArray[np.float64]: ...
    def smooth_all(
        self,
        sequences: Iterable[ArrayLike] | ArrayLike,
        lengths: ArrayLike | None = None,
        *,
        n_jobs: int = 1,
        progress: Callable[[int, int], object] | None = None,
    ) -> list[Smoothed]: ...
    def viterbi_all(
        self,
        sequences: Iterable[ArrayLike] | ArrayLike,
        lengths: ArrayLike | None = None,
        *,
        n_jobs: int = 1,
        progress: Callable[[int, int], object] | None = None,
    ) -> list[Path]: ...
    def filter(self) -> Filter: ...
    def filter_from_bytes(self, bytes: bytes) -> Filter: ...

def diagonal_log_densities(
    rows: NDArray[np.float64], means: NDArray[np.float64], variances: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def gaussian_log_densities(
    rows: NDArray[np.float64], means: NDArray[np.float64], covariances: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def poisson_log_densities(
    rows: NDArray[np.float64], rates: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def are_distributions(rows: NDArray[np.float64]) -> bool: ...
def log_likelihoods(
    start: NDArray[np.float64],
    transitions: NDArray[np.float64],
    logs: NDArray[np.float64],
    lengths: Sequence[int],
) -> NDArray[np.float64]: ...
def smooth(
    start: NDArray[np.float64],
    transitions: NDArray[np.float64],
    logs: NDArray[np.float64],
    lengths: Sequence[int],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def viterbi(
    start: NDArray[np.float64],
    transitions: NDArray[np.float64],
    logs: NDArray[np.float64],
    lengths: Sequence[int],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]: ...
def expectations(
    start: NDArray[np.float64],
    transitions: NDArray[np.float64],
    logs: NDArray[np.float64],
    lengths: Sequence[int],
) -> tuple[float, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def read_arrow(data: Any) -> Any: ...
def arrow_stream(columns: dict[str, Any]) -> Any: ...
