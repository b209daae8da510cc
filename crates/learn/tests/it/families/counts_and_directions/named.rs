//! Errors of each family, order of states, accessors of parameters, and files.

use wayfix_learn::Family as _;
use wayfix_learn::{
    Bernoulli, Beta, Binomial, EmissionError, Exponential, Gamma, Hurdle, Independent, LogNormal,
    Multinomial, NegativeBinomial, Poisson, VonMises, VonMisesFisher, Weibull, WrappedCauchy,
    ZeroInflated,
};

use super::kit::{Family, density, for_all_families, try_density};
use crate::kit::{rng, says, text};

for_all_families! { states_in_another_order_are_the_same_states }

fn states_in_another_order_are_the_same_states<B: Family>() {
    let states = [0.1, 0.5, 0.9].map(|unit| B::parameters(&[unit; 3]));
    let (family, order) = (B::build(&states), [2, 0, 1]);
    let other = family.reordered(&order);
    for (new, &old) in order.iter().enumerate() {
        let y = family.sample(old, &mut rng(old as u64));
        assert_eq!(density(&other, new, &y), density(&family, old, &y));
    }
    assert_eq!(other.reordered(&[1, 2, 0]), family);
}

#[cfg(feature = "serde")]
mod stored {
    use serde::{Serialize, de::DeserializeOwned};

    use super::*;

    fn back<B: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(family: &B) {
        let text = serde_json::to_string(family).unwrap();
        let read: B = serde_json::from_str(&text).unwrap();
        assert_eq!(read, *family);
        assert_eq!(serde_json::to_string(&read).unwrap(), text);
    }

    fn comes_back<B: Family + Serialize + DeserializeOwned>() {
        let states = [0.123, 0.5, 0.987].map(|unit| B::parameters(&[unit; 3]));
        back(&B::build(&states));
        back(&B::build(&states).missing().and_prior(&B::parameters(&[1.0 / 3.0; 3]), 0.1));
    }

    #[test]
    fn families_come_back_to_the_bit() {
        comes_back::<Independent<Bernoulli>>();
        comes_back::<Multinomial>();
        comes_back::<Independent<Poisson>>();
        comes_back::<Independent<Binomial>>();
        comes_back::<Independent<Exponential>>();
        comes_back::<Independent<NegativeBinomial>>();
        comes_back::<Independent<ZeroInflated<Gamma>>>();
        comes_back::<Independent<Hurdle<Poisson>>>();
        comes_back::<Independent<Weibull>>();
        comes_back::<Independent<Beta>>();
        comes_back::<Independent<WrappedCauchy>>();
        comes_back::<Independent<Gamma>>();
        comes_back::<Independent<LogNormal>>();
        comes_back::<Independent<VonMises>>();
        comes_back::<VonMisesFisher>();
    }

    #[test]
    fn invalid_families_are_refused() {
        let refused = |text: &str| {
            serde_json::from_str::<Independent<Poisson>>(text).unwrap_err().to_string()
        };
        assert_eq!(
            refused(r#"{"version":1,"rates":[[1.0],[-2.0]],"missing":false,"prior":null}"#),
            "the rate of state 1, component 0, is -2, expected a value from 0 to 2^53"
        );
        let prior = r#"{"version":1,"rates":[[1.0]],"missing":false,"prior":null}"#;
        let text = r#"{"version":1,"probabilities":[[0.5]],"inner":{"version":1,"rates":[[1.0]],"missing":true,"prior":null},"missing":false,"prior":null}"#;
        let error = serde_json::from_str::<Independent<ZeroInflated<Poisson>>>(text).unwrap_err();
        assert_eq!(error.to_string(), "the inner family has settings of its own");
        assert_eq!(
            refused(&format!(
                r#"{{"version":1,"rates":[[1.0]],"missing":false,"prior":[{prior},0.0]}}"#
            )),
            "the number of observations of the prior is 0, expected a finite value above 0"
        );
    }
}

#[test]
fn errors_name_state_component_and_value() {
    says(
        Poisson::family::<[f64; 0]>(&[]),
        "a family needs at least one state and one component, found 0 states and 0 components",
    );
    says(
        Poisson::family(&[vec![1.0], vec![]]),
        "the list of rates of state 1 has 0 values, expected 1",
    );
    says(
        Poisson::family(&[[1.0, f64::NAN]]),
        "the rate of state 0, component 1, is NaN, expected a value from 0 to 2^53",
    );
    says(
        Bernoulli::family(&[[0.5], [1.5]]),
        "the probability of state 1, component 0, is 1.5, expected a value from 0 to 1",
    );
    says(
        Gamma::family(&[[1.0], [0.0]], &[[1.0], [1.0]]),
        "the shape of state 1, component 0, is 0, expected a finite value above 0 (from 2.2e-308)",
    );
    says(
        Gamma::family(&[[1e-200]], &[[1e-200]]),
        "the product of shape and scale of state 0, component 0, is 0, expected a finite value above 0 (from 2.2e-308)",
    );
    says(Gamma::family(&[[1.0]], &[[1.0], [1.0]]), "the list of scales has 2 values, expected 1");
    says(
        LogNormal::family(&[[800.0]], &[[1.0]]),
        "the mean of logarithms of state 0, component 0, is 800, expected a value from -745 to 710",
    );
    says(
        VonMises::family(&[[0.0]], &[[-1.0]]),
        "the concentration of state 0, component 0, is -1, expected a value from 0 to 1e300",
    );
    says(
        VonMisesFisher::new(&[[1.0, 1.0]], &[1.0]),
        "the length of the mean direction of state 0 is 1.4142135623730951, expected 1 within 1e-6",
    );
    says(
        VonMisesFisher::new(&[[1.0]], &[1.0]),
        "the number of components is 1, expected at least 2",
    );
    says(
        VonMisesFisher::new(&[[1.0, 0.0]], &[]),
        "the list of concentrations has 0 values, expected 1",
    );
    says(
        Multinomial::new(&[[0.5, 0.5], [0.5, 0.25]]),
        "the sum of probabilities of state 1 is 0.75, expected 1",
    );
    says(
        Multinomial::new(&[[0.5, -0.5]]),
        "the probability of state 0, component 1, is -0.5, expected a value from 0 to 1",
    );
    let poisson = || Poisson::family(&[[1.0, 2.0]]).unwrap();
    says(
        poisson().with_prior(Poisson::family(&[[1.0]]).unwrap(), 1.0),
        "the list of components of the prior has 1 values, expected 2",
    );
    says(
        poisson().with_prior(Poisson::family(&[[1.0; 2]; 2]).unwrap(), 1.0),
        "the list of states of the prior has 2 values, expected 1",
    );
    assert!(matches!(
        Independent::<Poisson>::from_rows::<[_; 0]>(&[]),
        Err(EmissionError::Empty { .. })
    ));
}

#[test]
fn errors_of_further_distributions_do_so_too() {
    says(
        Binomial::family(&[5, 0], &[[0.5, 0.5]]),
        "the number of trials of state 0, component 1, is 0, expected a whole number from 1 to 2^32 - 1",
    );
    says(
        Binomial::family(&[5], &[[0.5, 0.5]]),
        "the list of numbers of trials has 1 values, expected 2",
    );
    says(
        ZeroInflated::family(&[[0.5], [1.5]], &[[Poisson::new(1.0).unwrap()]; 2]),
        "the probability of 0 of state 1, component 0, is 1.5, expected a value from 0 to 1",
    );
    says(
        Hurdle::family(&[[0.5]], &[[Poisson::new(0.0).unwrap()]]),
        "the probability of 0 of the distribution of state 0, component 0, is 1, expected a value below 1",
    );
    says(
        Hurdle::family(&[[0.5], [0.5]], &[[Poisson::new(1.0).unwrap()]]),
        "the list of distributions has 1 values, expected 2",
    );
    says(
        Exponential::family(&[[0.0]]),
        "the rate of state 0, component 0, is 0, expected a value from 2.3e-308 to 4.4e307",
    );
    says(
        Beta::family(&[[1.0]], &[[f64::NAN]]),
        "the second shape of state 0, component 0, is NaN, expected a value from 1e-100 to 1e100",
    );
    says(
        WrappedCauchy::family(&[[0.0]], &[[1.0]]),
        "the concentration of state 0, component 0, is 1, expected a value from 0 to below 1",
    );
}

/// NaN too, unless missing components are asked for.
#[test]
fn invalid_observations_are_named() {
    let of = |family: &dyn Fn(&[f64]) -> String, y: &[f64], expected: &str| {
        assert!(family(y).ends_with(expected), "{}", family(y));
    };
    let poisson = Poisson::family(&[[1.0, 2.0]]).unwrap();
    let found = |y: &[f64]| text(try_density(&poisson, 0, y));
    of(&found, &[1.0], "the observation has 1 components, expected 2");
    of(
        &found,
        &[1.0, 0.5],
        "component 1 of the observation is 0.5, expected a whole number from 0 to 2^53",
    );
    of(
        &found,
        &[f64::NAN, 1.0],
        "component 0 of the observation is NaN, expected a whole number from 0 to 2^53",
    );
    let poisson = poisson.clone().with_missing();
    let found = |y: &[f64]| text(try_density(&poisson, 0, y));
    of(
        &found,
        &[f64::NAN, -1.0],
        "component 1 of the observation is -1, expected a whole number from 0 to 2^53",
    );
    let events = Bernoulli::family(&[[0.5]]).unwrap();
    of(&|y| text(try_density(&events, 0, y)), &[2.0], "is 2, expected 0 or 1");
    let gamma = Gamma::family(&[[1.0]], &[[1.0]]).unwrap();
    of(&|y| text(try_density(&gamma, 0, y)), &[0.0], "is 0, expected a finite value above 0");
    let steps = ZeroInflated::family(&[[0.5]], &[[Gamma::new(1.0, 1.0).unwrap()]]).unwrap();
    let expected = "is -1, expected 0, or a value of the distribution beside it";
    of(&|y| text(try_density(&steps, 0, y)), &[-1.0], expected);
    let angles = VonMises::family(&[[1.0]], &[[1.0]]).unwrap();
    of(
        &|y| text(try_density(&angles, 0, y)),
        &[f64::INFINITY],
        "is inf, expected a finite angle in radians",
    );
    let vectors = VonMisesFisher::new(&[[0.6, 0.8]], &[1.0]).unwrap().with_missing();
    let found = |y: &[f64]| text(try_density(&vectors, 0, y));
    of(&found, &[3.0, 4.0], "the observation has length 5, expected 1 within 1e-6");
    of(&found, &[f64::NAN, 1.0], "component 0 of the observation is NaN, expected a finite value");
    let rows = Multinomial::new(&[[0.5, 0.5]]).unwrap().with_missing();
    let found = |y: &[f64]| text(try_density(&rows, 0, y));
    of(
        &found,
        &[f64::NAN, 1.0],
        "component 0 of the observation is NaN, expected a whole number from 0 to 2^53",
    );
    of(
        &found,
        &[9_007_199_254_740_992.0, 9_007_199_254_740_992.0],
        "component 1 of the observation is 9007199254740992, expected counts with a sum of up to 2^53",
    );
}

/// Parameters as `family` takes them, in the order of states.
#[test]
fn parameters_are_read_back() {
    let rates = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let family = Poisson::family(&rates).unwrap();
    assert_eq!(family.parameters(Poisson::rate), rates);
    assert_eq!(family.component(1, 2).map(Poisson::rate), Some(6.0));
    assert!(family.component(2, 0).is_none() && family.component(0, 3).is_none());
    assert_eq!((family.components(), family.takes_missing()), (3, false));
    let family = family.with_prior(Poisson::family(&[[7.0, 8.0, 9.0]]).unwrap(), 0.5).unwrap();
    let (prior, count) = family.prior().unwrap();
    assert_eq!((prior.parameters(Poisson::rate), count), (vec![vec![7.0, 8.0, 9.0]; 2], 0.5));
    let shares = [[0.25, 0.75], [0.5, 0.5]];
    assert_eq!(Multinomial::new(&shares).unwrap().probabilities(), shares);
}
