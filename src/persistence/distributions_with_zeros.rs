//! Formats of families of zeros beside another distribution.

use serde::de::Error as _;
use serde::ser::{Error as _, SerializeStruct};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::counts_and_directions::{families, with};
use super::{Version, refused};
use crate::emission::{self, Independent, Univariate};

// By hand, since the fields depend on families of `F` and on the family itself.
macro_rules! beside_zeros {
    ($($name:ident)*) => {$(
        const _: () = {
            // Has the name of the type, since formats and messages show it.
            #[derive(Deserialize)]
            #[serde(deny_unknown_fields)]
            struct $name<I, P> {
                version: Version,
                probabilities: Vec<Vec<f64>>,
                inner: I,
                missing: bool,
                prior: Option<(P, f64)>,
            }

            impl<F: Univariate> Serialize for families::$name<F>
            where
                Independent<F>: Serialize,
            {
                fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                    let inner = self.rows(|part| part.inner().clone());
                    let inner = Independent::from_rows(&inner).map_err(S::Error::custom)?;
                    let mut out = serializer.serialize_struct(stringify!($name), 5)?;
                    out.serialize_field("version", &Version)?;
                    let probabilities = self.parameters(emission::$name::probability);
                    out.serialize_field("probabilities", &probabilities)?;
                    out.serialize_field("inner", &inner)?;
                    out.serialize_field("missing", &self.takes_missing())?;
                    out.serialize_field("prior", &self.prior())?;
                    out.end()
                }
            }

            impl<'de, F: Univariate> Deserialize<'de> for families::$name<F>
            where
                Independent<F>: Deserialize<'de>,
            {
                fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                    let $name::<Independent<F>, Self> { version: Version, probabilities, inner, missing, prior } =
                        Deserialize::deserialize(from)?;
                    if inner.takes_missing() || inner.prior().is_some() {
                        return Err(D::Error::custom("the inner family has settings of its own"));
                    }
                    emission::$name::family(&probabilities, &inner.rows(F::clone))
                        .and_then(|new| with(new, missing, prior))
                        .map_err(refused)
                }
            }
        };
    )*};
}

beside_zeros! { ZeroInflated Hurdle }
