//! Textbook models with their exact answers, written out.
#![allow(clippy::excessive_precision, clippy::unreadable_literal, reason = "printed answers")]

use wayfix::inference::Order;
use wayfix::transition::SwitchedTransition;
use wayfix::{
    Belief, Controlled, DenseTransition, Hmm, HmmError, LikelihoodVector, Prior, SparseTransition,
    TransitionEntries,
};

struct Case {
    name: &'static str,
    /// The prior's convention: at the first observation, or one transition
    /// before it.
    at_first: bool,
    prior: &'static [f64],
    /// One matrix, or one for each transition; rows are from.
    transitions: &'static [&'static [&'static [f64]]],
    likelihoods: &'static [&'static [f64]],
    log_likelihood: f64,
    filtered: &'static [&'static [f64]],
    smoothed: &'static [&'static [f64]],
    /// Expected moves between observations; rows are the states that are left.
    pairwise_sum: &'static [&'static [f64]],
    viterbi_log: f64,
    viterbi: &'static [usize],
}

impl Case {
    fn prior(&self) -> Prior {
        let belief = Belief::new(self.prior.to_vec()).unwrap();
        if self.at_first {
            Prior::AtFirstObservation(belief)
        } else {
            Prior::BeforeFirstTransition(belief)
        }
    }

    /// Matrix m, transposed to the library's columns.
    fn entry(&self, m: usize) -> impl Fn(usize, usize) -> f64 {
        let rows = self.transitions[m];
        move |to, from| rows[from][to]
    }

    fn dense(&self, m: usize) -> DenseTransition {
        DenseTransition::from_fn(self.prior.len(), self.entry(m)).unwrap()
    }

    fn sparse(&self, m: usize) -> SparseTransition {
        let (n, entry) = (self.prior.len(), self.entry(m));
        let all = (0..n * n).map(|at| (at / n, at % n, entry(at / n, at % n)));
        SparseTransition::from_triplets(n, all).unwrap()
    }

    /// Number of the matrix that drives each step.
    fn controls(&self) -> Vec<usize> {
        let of = |step: usize| {
            if self.transitions.len() == 1 { 0 } else { step.saturating_sub(1) }
        };
        (0..self.likelihoods.len()).map(of).collect()
    }

    fn check<A: TransitionEntries<Control = usize>>(&self, transition: A) {
        let n = self.prior.len();
        let hmm = Hmm::new(self.prior(), transition, LikelihoodVector::linear(n)).unwrap();
        let controls = self.controls();
        let close = |what: &str, found: f64, expected: f64| {
            assert!((found - expected).abs() <= 1e-12, "{}, {what}: {found}", self.name);
        };

        let drive = Controlled::new(&controls, self.likelihoods).unwrap();
        let filtering = hmm.forward(&drive).unwrap();
        let smoothing = hmm.smooth(&drive).unwrap();
        close("log-likelihood", smoothing.log_likelihood(), self.log_likelihood);
        let mut filter = hmm.filter();
        for (index, (control, y)) in controls.iter().zip(self.likelihoods).enumerate() {
            filter.step_with(control, y).unwrap();
            for i in 0..n {
                let filtered = filtering.posteriors().get(index + 1).unwrap().as_slice()[i];
                let smoothed = smoothing.posteriors().get(index + 1).unwrap().as_slice()[i];
                close("streaming filter", filter.belief().as_slice()[i], self.filtered[index][i]);
                close("filtered", filtered, self.filtered[index][i]);
                close("smoothed", smoothed, self.smoothed[index][i]);
            }
        }
        close("streaming log-likelihood", filter.log_likelihood(), self.log_likelihood);

        let mut moves = vec![vec![0.0; n]; n];
        hmm.smooth_each(&drive, Order::Forward, |step| {
            // Moves between observations, without that from X_0.
            let found = step.moves().filter(|_| step.step() > 1);
            found.into_iter().flatten().for_each(|m| moves[m.from][m.to] += m.weight);
        })
        .unwrap();
        for (from, row) in self.pairwise_sum.iter().enumerate() {
            row.iter()
                .zip(&moves[from])
                .for_each(|(expected, sum)| close("moves", *sum, *expected));
        }

        let path = hmm.viterbi(&drive).unwrap();
        assert_eq!(hmm.k_best(&drive, 1).unwrap()[0], path, "{}", self.name);
        assert_eq!(path.states(), self.viterbi, "{}", self.name);
        close("Viterbi", path.log_probability(), self.viterbi_log);
    }
}

#[test]
fn dense_operators_give_the_known_answers() {
    for case in known_cases() {
        let operators = (0..case.transitions.len()).map(|m| case.dense(m)).collect();
        case.check(SwitchedTransition::new(operators).unwrap());
    }
}

#[test]
fn sparse_operators_give_the_known_answers() {
    for case in known_cases() {
        let operators = (0..case.transitions.len()).map(|m| case.sparse(m)).collect();
        case.check(SwitchedTransition::new(operators).unwrap());
    }
}

#[test]
fn an_impossible_observation_is_an_error_that_names_its_step() {
    let hmm = Hmm::new(
        Prior::AtFirstObservation(Belief::new(vec![1.0, 0.0]).unwrap()),
        DenseTransition::from_rows(&[[1.0, 0.0], [0.0, 1.0]]).unwrap(),
        LikelihoodVector::linear(2),
    )
    .unwrap();
    let ys = [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]];
    // The second observation, index 1, is step 2.
    let impossible = |error| matches!(error, HmmError::Impossible { step: 2 });
    assert!(impossible(hmm.smooth(&ys).unwrap_err()));
    assert!(impossible(hmm.viterbi(&ys).unwrap_err()));
    let mut filter = hmm.filter();
    filter.step(&ys[0]).unwrap();
    assert!(impossible(filter.step(&ys[1]).unwrap_err()));
}

/// Rows of the matrices are the states that are left.
#[rustfmt::skip]
#[expect(clippy::too_many_lines, reason = "data")]
fn known_cases() -> [Case; 9] {
    [
        Case {
            name: "umbrella UUNUU",
            at_first: true,
            prior: &[0.5, 0.5],
            transitions: &[&[&[0.7, 0.3], &[0.3, 0.7]]],
            likelihoods: &[&[0.9, 0.2], &[0.9, 0.2], &[0.1, 0.8], &[0.9, 0.2], &[0.9, 0.2]],
            log_likelihood: -3.3725020443321747,
            filtered: &[&[0.8181818181818182, 0.18181818181818182], &[0.883357041251778, 0.1166429587482219], &[0.19066793972352525, 0.8093320602764748], &[0.7307940045849821, 0.26920599541501794], &[0.8673388895754848, 0.13266111042451528]],
            smoothed: &[&[0.8673388895754848, 0.13266111042451528], &[0.8204190536236754, 0.17958094637632463], &[0.3074835760066177, 0.6925164239933823], &[0.8204190536236754, 0.17958094637632463], &[0.8673388895754848, 0.13266111042451528]],
            pairwise_sum: &[&[2.080186188659151, 0.7354743841703025], &[0.7354743841703025, 0.44886504300024427]],
            viterbi_log: -4.459028291034797,
            viterbi: &[0, 0, 1, 0, 0],
        },
        Case {
            name: "umbrella UU, prior one transition before",
            at_first: false,
            prior: &[0.5, 0.5],
            transitions: &[&[&[0.7, 0.3], &[0.3, 0.7]]],
            likelihoods: &[&[0.9, 0.2], &[0.9, 0.2]],
            log_likelihood: -1.0455455677314176,
            filtered: &[&[0.8181818181818182, 0.18181818181818182], &[0.883357041251778, 0.1166429587482219]],
            smoothed: &[&[0.883357041251778, 0.1166429587482219], &[0.883357041251778, 0.1166429587482219]],
            pairwise_sum: &[&[0.8065433854907539, 0.07681365576102418], &[0.07681365576102418, 0.03982930298719772]],
            viterbi_log: -1.2605431558143303,
            viterbi: &[0, 0],
        },
        Case {
            name: "rainy/sunny: walk shop clean",
            at_first: true,
            prior: &[0.6, 0.4],
            transitions: &[&[&[0.7, 0.3], &[0.4, 0.6]]],
            likelihoods: &[&[0.1, 0.6], &[0.4, 0.3], &[0.5, 0.1]],
            log_likelihood: -3.3928721329161657,
            filtered: &[&[0.2, 0.8], &[0.5317919075144508, 0.4682080924855491], &[0.8639771510174937, 0.13602284898250624]],
            smoothed: &[&[0.2317029632274188, 0.7682970367725812], &[0.6240628347018922, 0.37593716529810783], &[0.8639771510174937, 0.13602284898250624]],
            pairwise_sum: &[&[0.76472688325598, 0.09103891467333096], &[0.723313102463406, 0.42092109960728313]],
            viterbi_log: -4.309519943887134,
            viterbi: &[1, 0, 0],
        },
        Case {
            name: "healthy/fever",
            at_first: true,
            prior: &[0.6, 0.4],
            transitions: &[&[&[0.7, 0.3], &[0.4, 0.6]]],
            likelihoods: &[&[0.5, 0.1], &[0.4, 0.3], &[0.1, 0.6]],
            log_likelihood: -3.316488653735201,
            filtered: &[&[0.8823529411764706, 0.11764705882352941], &[0.7255216693418941, 0.27447833065810595], &[0.21212789415656008, 0.7878721058434399]],
            smoothed: &[&[0.87651598676957, 0.12348401323042998], &[0.6229327453142227, 0.3770672546857773], &[0.21212789415656008, 0.7878721058434399]],
            pairwise_sum: &[&[0.7532524807056229, 0.7461962513781698], &[0.08180815876515987, 0.4187431091510474]],
            viterbi_log: -4.19173690823075,
            viterbi: &[0, 0, 1],
        },
        Case {
            name: "GC content GGCA",
            at_first: true,
            prior: &[0.5, 0.5],
            transitions: &[&[&[0.5, 0.5], &[0.4, 0.6]]],
            likelihoods: &[&[0.3, 0.2], &[0.3, 0.2], &[0.3, 0.2], &[0.2, 0.3]],
            log_likelihood: -5.561462936154914,
            filtered: &[&[0.6, 0.4], &[0.5609756097560976, 0.43902439024390244], &[0.5571002979145978, 0.4428997020854022], &[0.3582217712033098, 0.6417782287966902]],
            smoothed: &[&[0.6106319035166465, 0.3893680964833535], &[0.5700402013972913, 0.4299597986027087], &[0.5474025213691893, 0.4525974786308107], &[0.3582217712033098, 0.6417782287966902]],
            pairwise_sum: &[&[0.9273642714960384, 0.8007103547870887], &[0.548300222473752, 0.7236251512431209]],
            viterbi_log: -7.588479939543525,
            viterbi: &[0, 0, 0, 1],
        },
        Case {
            name: "ice cream 3 1 3",
            at_first: true,
            prior: &[0.8, 0.2],
            transitions: &[&[&[0.6, 0.4], &[0.5, 0.5]]],
            likelihoods: &[&[0.4, 0.1], &[0.2, 0.5], &[0.4, 0.1]],
            log_likelihood: -3.5556781159513955,
            filtered: &[&[0.9411764705882353, 0.058823529411764705], &[0.3692870201096892, 0.6307129798903108], &[0.8226314683845669, 0.1773685316154331]],
            smoothed: &[&[0.9366290875989076, 0.06337091240109236], &[0.3960506967299209, 0.6039493032700791], &[0.8226314683845669, 0.1773685316154331]],
            pairwise_sum: &[&[0.7159162523632799, 0.6167635319655487], &[0.5027659127512079, 0.1645543029199636]],
            viterbi_log: -4.358310108056566,
            viterbi: &[0, 1, 0],
        },
        Case {
            name: "masked random walk (missing observations)",
            at_first: true,
            prior: &[1.0, 0.0, 0.0, 0.0],
            transitions: &[&[&[0.75, 0.25, 0.0, 0.0], &[0.25, 0.5, 0.25, 0.0], &[0.0, 0.25, 0.5, 0.25], &[0.0, 0.0, 0.25, 0.75]]],
            likelihoods: &[&[1.0, 0.0, 0.0, 0.0], &[1.0, 1.0, 1.0, 1.0], &[1.0, 1.0, 1.0, 1.0], &[1.0, 1.0, 1.0, 1.0], &[1.0, 1.0, 1.0, 1.0], &[1.0, 1.0, 1.0, 1.0], &[1.0, 0.0, 0.0, 0.0]],
            log_likelihood: -0.8700148866714361,
            filtered: &[&[1.0, 0.0, 0.0, 0.0], &[0.75, 0.25, 0.0, 0.0], &[0.625, 0.3125, 0.0625, 0.0], &[0.546875, 0.328125, 0.109375, 0.015625], &[0.4921875, 0.328125, 0.140625, 0.0390625], &[0.451171875, 0.322265625, 0.162109375, 0.064453125], &[1.0, 0.0, 0.0, 0.0]],
            smoothed: &[&[1.0, 0.0, 0.0, 0.0], &[0.8076923076923077, 0.19230769230769232, 0.0, 0.0], &[0.7342657342657343, 0.24475524475524477, 0.02097902097902098, 0.0], &[0.7138694638694638, 0.256993006993007, 0.028554778554778556, 0.0005827505827505828], &[0.7342657342657343, 0.24475524475524477, 0.02097902097902098, 0.0], &[0.8076923076923077, 0.19230769230769232, 0.0, 0.0], &[1.0, 0.0, 0.0, 0.0]],
            pairwise_sum: &[&[4.160839160839161, 0.6369463869463869, 0.0, 0.0], &[0.6369463869463869, 0.4405594405594406, 0.053613053613053616, 0.0], &[0.0, 0.053613053613053616, 0.016317016317016316, 0.0005827505827505828], &[0.0, 0.0, 0.0005827505827505828, 0.0]],
            viterbi_log: -1.7260924347106856,
            viterbi: &[0, 0, 0, 0, 0, 0, 0],
        },
        Case {
            name: "time-varying, nothing observed",
            at_first: true,
            prior: &[0.5, 0.5],
            transitions: &[&[&[0.6, 0.4], &[0.5, 0.5]], &[&[0.7, 0.3], &[0.4, 0.6]], &[&[0.9, 0.1], &[0.3, 0.7]]],
            likelihoods: &[&[1.0, 1.0], &[1.0, 1.0], &[1.0, 1.0], &[1.0, 1.0]],
            log_likelihood: 0.0,
            filtered: &[&[0.5, 0.5], &[0.55, 0.45], &[0.565, 0.435], &[0.639, 0.361]],
            smoothed: &[&[0.5, 0.5], &[0.55, 0.45], &[0.565, 0.435], &[0.639, 0.361]],
            pairwise_sum: &[&[1.1935, 0.4215], &[0.5605, 0.8245]],
            viterbi_log: -1.6660082639224947,
            viterbi: &[0, 0, 0, 0],
        },
        Case {
            name: "dishonest casino",
            at_first: true,
            prior: &[0.5, 0.5],
            transitions: &[&[&[0.95, 0.05], &[0.1, 0.9]]],
            likelihoods: &[&[0.16666666666666666, 0.1], &[0.16666666666666666, 0.5], &[0.16666666666666666, 0.5], &[0.16666666666666666, 0.5], &[0.16666666666666666, 0.5], &[0.16666666666666666, 0.5], &[0.16666666666666666, 0.1], &[0.16666666666666666, 0.1], &[0.16666666666666666, 0.1], &[0.16666666666666666, 0.1]],
            log_likelihood: -15.12482637868727,
            filtered: &[&[0.625, 0.375], &[0.36330935251798563, 0.6366906474820144], &[0.18732487225976593, 0.8126751277402341], &[0.10446147766106187, 0.8955385223389382], &[0.07199174077392284, 0.9280082592260772], &[0.060200229461239874, 0.9397997705387602], &[0.22888342385292954, 0.7711165761470705], &[0.410340699431389, 0.589659300568611], &[0.5757286417418307, 0.42427135825816925], &[0.7052000484684541, 0.2947999515315459]],
            smoothed: &[&[0.1414663290770408, 0.8585336709229592], &[0.06627408920982081, 0.9337259107901792], &[0.04369465575088002, 0.95630534424912], &[0.04607929106275073, 0.9539207089372492], &[0.0763480044635962, 0.9236519955364038], &[0.1715651322648439, 0.8284348677351561], &[0.44832498096037454, 0.5516750190396255], &[0.5984935400764169, 0.40150645992358314], &[0.6751009223517929, 0.3248990776482071], &[0.7052000484684541, 0.2947999515315459]],
            pairwise_sum: &[&[2.096040342999543, 0.171306602217974], &[0.7350403216093873, 5.997612733173096]],
            viterbi_log: -16.611773607711765,
            viterbi: &[1, 1, 1, 1, 1, 1, 0, 0, 0, 0],
        },
    ]
}
