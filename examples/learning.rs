//! Learns turning probabilities by road class from drives with uncertain observations only, and
//! shows that they improve tracking.
//!
//! ```text
//! cargo run --release --example learning
//! ```

use std::error::Error;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::inference::{LearningOptions, Simulation};
use wayfix::map::{TurningProbabilities, TurningRule};
use wayfix::{Belief, Fixed, Hmm, Prior, canberra, evaluate};

fn main() -> Result<(), Box<dyn Error>> {
    // With no prior knowledge, staying and each road are equally probable.
    let map = canberra::map();
    let any_road = (0..canberra::PLACES).flat_map(|from| {
        let ways: Vec<usize> = map.neighbors(from).chain([from]).collect();
        let share = 1.0 / ways.len() as f64;
        ways.into_iter().map(move |to| (from, to, share))
    });
    // Tied by road class: moves of one kind share a parameter, so 200 drives are enough.
    let unknown = TurningProbabilities::new(&map, any_road)?.tied(&map);
    let anywhere = Prior::AtFirstObservation(Belief::uniform(canberra::PLACES)?);
    // `Fixed` keeps the sensor out of learning.
    let camera = Fixed(canberra::sensor(2.0)?);
    let guess = Hmm::new(anywhere.clone(), unknown, camera.clone())?.with_rounded_tails();

    // The true behaviour: 200 recorded drives to learn from, and 200 to track.
    let truth = TurningProbabilities::by_rule(&map, &TurningRule::default())?.into_transition();
    let truth = Hmm::new(anywhere, truth, camera)?.with_rounded_tails();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut drives = |count| (0..count).map(|_| truth.simulate(50, &mut rng)).collect::<Vec<_>>();
    let (recorded, new) = (drives(200), drives(200));

    let sightings: Vec<&[usize]> = recorded.iter().map(Simulation::observations).collect();
    // The prior is kept: 200 drives say little about where a drive starts. A pseudo-count keeps
    // moves possible that were never seen.
    let learning =
        LearningOptions::default().with_keep_prior(true).with_transition_pseudo_count(1.0);
    let learned = guess.learn(&sightings, &learning)?;
    println!(
        "{} parameters from {} drives: {} after {} iterations, objective {:.3} to {:.3}",
        guess.transition().parameters(),
        recorded.len(),
        if learned.converged() { "Converged" } else { "Not converged" },
        learned.iterations(),
        learned.objectives()[0],
        learned.objectives()[learned.iterations()],
    );

    // The log-likelihoods of new drives compare the models.
    let sightings: Vec<&[usize]> = new.iter().map(Simulation::observations).collect();
    let score = |scores: Vec<Result<f64, _>>| scores.into_iter().sum::<Result<f64, _>>();
    println!(
        "ln p of new drives, as guessed:  {:.3}",
        score(guess.log_likelihood_all(&sightings))?
    );
    println!(
        "ln p of new drives, as learned:  {:.3}",
        score(learned.model().log_likelihood_all(&sightings))?
    );
    println!(
        "ln p of new drives, true model:  {:.3}",
        score(truth.log_likelihood_all(&sightings))?
    );

    let mut accuracies = [0.0; 3];
    for drive in &new {
        let ys = drive.observations();
        let modes = [guess.smooth(ys)?, learned.model().smooth(ys)?, truth.smooth(ys)?];
        for (sum, modes) in accuracies.iter_mut().zip(&modes) {
            *sum += evaluate::accuracy(drive.states(), &modes.posteriors().modes())?;
        }
    }
    let [guess, learned, truth] = accuracies.map(|sum| sum / new.len() as f64);
    println!("smoother's accuracy: guessed {guess:.4}, learned {learned:.4}, true {truth:.4}");
    Ok(())
}
