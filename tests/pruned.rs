//! The pruned filter against the exact one.

mod common;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::{Pruning, canberra};

#[test]
fn explore() {
    for sigma in [1.0, 2.0] {
        let hmm = canberra::hmm(5, sigma).unwrap();
        for seed in 0..3 {
            let drive = hmm.simulate(5000, &mut ChaCha8Rng::seed_from_u64(seed));
            let mut exact = hmm.filter();
            let mut pruned = hmm.pruned_filter(Pruning::default());
            let (mut worst, mut active, mut bad, mut true_worst, mut most) = (0.0f64, 0, 0, 0.0f64, 0);
            for (k, y) in drive.observations().iter().enumerate() {
                exact.step(y).unwrap();
                let certificate = pruned.step(y).unwrap();
                let tv = exact.belief().as_slice().iter().enumerate().map(|(i, p)| (p - pruned.probability(i).unwrap()).abs()).sum::<f64>() / 2.0;
                assert!(tv <= certificate.bound() + 1e-15, "step {k}: {tv} {certificate:?}");
                worst = worst.max(certificate.bound());
                true_worst = true_worst.max(tv);
                bad += usize::from(!certificate.holds());
                active += pruned.active().len();
                most = most.max(pruned.active().len());
                if k % 1000 == 0 || (!certificate.holds() && bad < 5) { println!("{k} {certificate:?} tv {tv:e} active {} {:?}", pruned.active().len(), pruned.log_likelihood()); }
            }
            println!("sigma {sigma} seed {seed} worst {worst:e} true {true_worst:e} bad {bad} mean active {} most {most}; exact {} ", active as f64 / 5000.0, exact.log_likelihood());
        }
    }
}
