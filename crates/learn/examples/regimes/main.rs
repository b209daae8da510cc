//! Finds the regimes of a market in daily returns and trading volumes: their number and properties,
//! the regime of each day, a forecast of the coming days, and the fit of the model.
//!
//! ```text
//! cargo run --release -p wayfix-learn --example regimes -- [--seed N] [--repeat N] [--out FOLDER]
//! ```
//!
//! The data are simulated from three regimes, so that the answers can be compared with the truth.
//! No real market is as simple.

mod forecast;
mod market;
mod picture;
mod residuals;

use std::error::Error;
use std::fs;
use std::path::PathBuf;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use wayfix::inference::{LearnError, LearnedModel, LearningOptions};
use wayfix::{DenseTransition, Hmm};
use wayfix_learn::{CovarianceType, Gaussian, GaussianPrior, StartKind, starts};
use wayfix_learn::{ModelSelection, Predictive};

use forecast::Forecast;
use market::Year;
use picture::Shown;
use residuals::Residuals;

/// Random starts of each model.
const STARTS: usize = 5;
/// Number of days to forecast.
const AHEAD: usize = 60;

type Model = Hmm<DenseTransition, Gaussian>;
type Learned = LearnedModel<DenseTransition, Gaussian>;

#[derive(Parser)]
#[command(about = "Finds the regimes of a simulated market")]
struct Arguments {
    /// Seed of the simulation and of the starts.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of simulated markets, to see how often the number of regimes is found.
    #[arg(long, default_value_t = 1)]
    repeat: u64,
    /// Folder for the pictures and the table of days.
    #[arg(long, default_value = "target/regimes")]
    out: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let mut found = [0; 7];
    for seed in arguments.seed..arguments.seed + arguments.repeat {
        let years = market::simulate(12, 252, seed)?;
        let selection = choose(&years, seed)?;
        let states = *selection.best_by_bic();
        // Only the first market is described; the others show how often the number is found.
        found[states] += 1;
        if seed == arguments.seed {
            println!("{selection}");
            let held_out = selection.best_held_out().unwrap_or(&0);
            println!("lowest BIC: {states} regimes; best on held-out years: {held_out}\n");
            describe(&years, states, seed, &arguments.out)?;
        }
    }
    if arguments.repeat > 1 {
        println!("\nregimes by BIC in {} markets of 3:", arguments.repeat);
        let counts = found.iter().enumerate().filter(|count| *count.1 > 0);
        counts.for_each(|(states, count)| println!("{states}: {count}"));
    }
    Ok(())
}

/// Learns a model from several starts.
///
/// The prior covariance counts for ten days: without it, a regime of a few odd days could make the
/// likelihood arbitrarily high.
fn learn(states: usize, years: &[&Year], seed: u64) -> Result<Learned, LearnError> {
    let prior = GaussianPrior::new(2).and_then(|prior| prior.with_covariance(10.0, &[10.0, 0.5]));
    // A placeholder: starts only take its number of states, its type of covariance and its prior.
    let family = Gaussian::new(
        CovarianceType::Full,
        &vec![[0.0; 2]; states],
        &vec![[1.0, 0.0, 0.0, 1.0]; states],
    )
    .and_then(|family| family.with_prior(prior?))?;
    let starts = starts(&family, years, STARTS, &mut ChaCha8Rng::seed_from_u64(seed))?;
    Hmm::learn_best(&starts, years, &LearningOptions::default(), |_, _| ())
}

/// Returns the model with its regimes in ascending order of volatility.
fn ordered(model: &Model) -> Result<Model, LearnError> {
    // Component 0 is the return, and c[0] its variance.
    let variances: Vec<f64> = model.likelihood().covariances().iter().map(|c| c[0]).collect();
    let mut order: Vec<usize> = (0..variances.len()).collect();
    order.sort_by(|&a, &b| variances[a].total_cmp(&variances[b]));
    Ok(model.reordered(&order)?)
}

/// Compares two to six regimes by information criteria and by cross-validation over four folds of
/// years.
fn choose(years: &[Year], seed: u64) -> Result<ModelSelection<usize>, LearnError> {
    // Each of five numbers of regimes is fitted to all years, and once without each of four folds.
    let fits = 5 * 5;
    let style =
        ProgressStyle::with_template("learning {bar:30} {pos}/{len} fits of several starts");
    let bar =
        ProgressBar::new(fits).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let selection = ModelSelection::new(2..=6, years, 4, |&states, some: &[&Year]| {
        let learned = learn(states, some, seed);
        bar.inc(1);
        learned
    });
    bar.finish_and_clear();
    selection
}

/// Names of the regimes, in ascending order of volatility.
fn names(states: usize) -> Vec<String> {
    let known: &[&str] = match states {
        2 => &["calm", "panic"],
        3 => &["calm", "nervous", "panic"],
        4 => &["calm", "uneasy", "nervous", "panic"],
        5 => &["calm", "uneasy", "nervous", "stormy", "panic"],
        _ => &["calm", "quiet", "uneasy", "nervous", "stormy", "panic"],
    };
    known.iter().map(ToString::to_string).collect()
}

/// Prints and draws the regimes, and the forecast of the days after the last one.
fn describe(years: &[Year], states: usize, seed: u64, out: &PathBuf) -> Result<(), Box<dyn Error>> {
    let all: Vec<&Year> = years.iter().collect();
    let learned = learn(states, &all, seed)?;
    let (kind, ends) = (StartKind::of(learned.start()), learned.ends());
    println!("best start: {}, by {kind}; different ends of {STARTS}: {ends}\n", learned.start());
    let model = ordered(learned.model())?;
    println!("regime     mean return   volatility   volume   days at a time");
    let (names, mut moments) = (names(states), Vec::new());
    for (state, name) in names.iter().enumerate() {
        let (Some(mean), Some(covariance)) =
            (model.likelihood().mean(state), model.likelihood().covariance(state))
        else {
            continue;
        };
        // A stay in a regime is geometric, of mean 1 / (1 − p).
        let days = 1.0 / (1.0 - model.transition().get(state, state));
        let volatility = covariance[0].sqrt();
        println!(
            "{name:<8}   {:>9.3} %   {volatility:>8.3} %   {:>6.2}   {days:>14.1}",
            mean[0], mean[1]
        );
        moments.push([mean[0], volatility]);
    }

    // The past of the last year is smoothed, the future is a forecast from its end. Years are
    // separate sequences, so the filter sees the last one alone.
    let year = &years[years.len() - 1];
    let smoothed = model.smooth(year)?;
    let probabilities: Vec<Vec<f64>> =
        smoothed.posteriors().iter().map(|belief| belief.as_slice().to_vec()).collect();
    let mut filter = model.filter();
    year.days.iter().try_for_each(|day| filter.step(day.as_slice()).map(|_| ()))?;
    let ahead = (1..=AHEAD)
        .map(|days| Ok(filter.forecast(days)?.as_slice().to_vec()))
        .collect::<Result<Vec<Vec<f64>>, Box<dyn Error>>>()?;
    println!("\nprobabilities of the regimes, today and {AHEAD} days ahead:");
    for (day, belief) in
        [("today", &probabilities[probabilities.len() - 1]), ("then", &ahead[AHEAD - 1])]
    {
        let shares = names.iter().zip(belief).map(|(name, p)| format!("{name} {p:.3}"));
        println!("{day:>6}   {}", shares.collect::<Vec<String>>().join("   "));
    }
    let next = Predictive::ahead(&filter, 1, 0)?;
    println!("\nreturn of the next day, by its probability of being below:");
    for p in [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99] {
        println!("{:>6.0} %   {:>6.2} %", 100.0 * p, next.quantile(p)?);
    }
    println!("probability of a loss above 2 %: {:.3}", next.tails(-2.0).below);
    let forecast = Forecast::new(&filter, AHEAD, seed)?;
    println!("\ncentral 90% of the forecast:");
    for (what, [low, .., high]) in [
        ("return of the next day", forecast.returns[0]),
        (&format!("return of the day {AHEAD} days ahead"), forecast.returns[AHEAD - 1]),
        (&format!("return of all {AHEAD} days"), forecast.total[AHEAD - 1]),
    ] {
        println!("{what:<32}   {low:>6.2} % to {high:>5.2} %");
    }

    fs::create_dir_all(out)?;
    let mut table = csv::Writer::from_path(out.join("days.csv"))?;
    let head = ["day", "return", "volume", "true_regime"].map(String::from);
    table.write_record(head.into_iter().chain(names.iter().map(|name| name.replace(' ', "_"))))?;
    for (day, ((seen, truth), belief)) in
        (1..).zip(year.days.iter().zip(&year.regimes).zip(&probabilities))
    {
        let values = [day.to_string(), seen[0].to_string(), seen[1].to_string(), truth.to_string()];
        table.write_record(values.into_iter().chain(belief.iter().map(f64::to_string)))?;
    }
    table.flush()?;
    let names = names.iter().zip(moments);
    let names = names.map(|(name, [mean, volatility])| {
        // A minus sign (U+2212), since a hyphen is hard to see.
        let sign = if mean < 0.0 { "−" } else { "" };
        format!("{name}: {sign}{:.2} ± {volatility:.2} % a day", mean.abs())
    });
    let beliefs = probabilities.into_iter().chain(ahead).collect();
    let shown = Shown { year, names: names.collect(), beliefs, forecast };
    shown.draw(&out.join("regimes.svg"))?;
    let residuals = Residuals::new(&model, years)?;
    residuals.describe();
    residuals.draw(&out.join("residuals.svg"))?;
    println!("\nwritten: {0}/regimes.svg, {0}/residuals.svg, {0}/days.csv", out.display());
    Ok(())
}
