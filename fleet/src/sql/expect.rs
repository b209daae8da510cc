//! Expectations of drives as an aggregate, for learning: partial sums per task, merged in the final
//! one.

use arrow::array::{Array, ArrayRef, AsArray, BinaryArray};
use arrow::datatypes::{DataType, Field, FieldRef};
use datafusion::common::{Result, internal_err, plan_err};
use datafusion::error::DataFusionError;
use datafusion::logical_expr::function::{AccumulatorArgs, StateFieldsArgs};
use datafusion::logical_expr::{
    Accumulator, AggregateUDFImpl, Signature, TypeSignature, Volatility,
};
use datafusion::scalar::ScalarValue;
use serde::{Deserialize, Serialize};

use super::function::{drives, failure};
use super::models::Models;
use crate::error::{FleetError, Outcome};
use crate::expected::{Expected, Sums};
use crate::model::{Model, with_hmm};

/// Name of the aggregate.
pub(super) const NAME: &str = "wayfix_expect";

/// The aggregate: expectations of all drives of a group, as JSON; null without drives.
#[derive(Debug, PartialEq, Eq, Hash)]
pub(super) struct Expect {
    models: Models,
    signature: Signature,
}

impl Expect {
    pub(super) fn new(models: Models) -> Self {
        let counts = [2, 3, 4].map(TypeSignature::Any).to_vec();
        Self { models, signature: Signature::one_of(counts, Volatility::Stable) }
    }
}

impl AggregateUDFImpl for Expect {
    fn name(&self) -> &str {
        NAME
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn return_type(&self, _: &[DataType]) -> Result<DataType> {
        Ok(DataType::Binary)
    }

    fn state_fields(&self, args: StateFieldsArgs<'_>) -> Result<Vec<FieldRef>> {
        Ok(vec![Field::new(format!("{}[sums]", args.name), DataType::Binary, true).into()])
    }

    fn accumulator(&self, _: AccumulatorArgs<'_>) -> Result<Box<dyn Accumulator>> {
        Ok(Box::new(Sum { models: self.models.clone(), known: None }))
    }
}

/// Expectations so far, and the name of the model.
#[derive(Debug)]
struct Sum {
    models: Models,
    known: Option<(String, Expected)>,
}

/// Sums as they are sent between tasks.
#[derive(Serialize, Deserialize)]
pub(super) struct Sent {
    model: String,
    pub(super) sums: Sums,
}

impl Sum {
    fn add(&mut self, name: &str, model: &Model, expected: Expected) -> Outcome<()> {
        match &mut self.known {
            None => self.known = Some((name.to_owned(), expected)),
            Some((known, sum)) if known == name => {
                with_hmm!(model, hmm => sum.merge(hmm, &expected));
            }
            Some((known, _)) => {
                let message = format!("{known} and {name} are two models, expected one");
                return Err(FleetError::Settings(message));
            }
        }
        Ok(())
    }

    fn json(&self) -> Result<ScalarValue> {
        let Some((model, sum)) = &self.known else { return Ok(ScalarValue::Binary(None)) };
        let sent = Sent { model: model.clone(), sums: sum.sums() };
        // JSON of finite doubles is exact: shortest digits that read back as the same value.
        let text = serde_json::to_vec(&sent);
        let text = text.map_err(|error| DataFusionError::External(Box::new(error)))?;
        Ok(ScalarValue::Binary(Some(text)))
    }
}

impl Accumulator for Sum {
    fn update_batch(&mut self, values: &[ArrayRef]) -> Result<()> {
        let Some((names, arguments)) = values.split_first() else {
            return internal_err!("{NAME} has no arguments");
        };
        if names.is_empty() {
            return Ok(());
        }
        // The model is a literal, so the first row has it for all.
        let ScalarValue::Utf8(Some(name)) =
            ScalarValue::try_from_array(names, 0)?.cast_to(&DataType::Utf8)?
        else {
            return plan_err!("the model of {NAME} is null, expected the path of its file");
        };
        let run = |sum: &mut Self| {
            let loaded = sum.models.model(&name)?;
            let drives = drives(&loaded, arguments)?;
            let expected = with_hmm!(loaded.model, hmm => Expected::of(hmm, &drives)?);
            sum.add(&name, &loaded.model, expected)
        };
        run(self).map_err(|error| failure(NAME, error, arguments))
    }

    fn merge_batch(&mut self, states: &[ArrayRef]) -> Result<()> {
        let Some(states) = states.first() else { return Ok(()) };
        let states: &BinaryArray = states.as_binary();
        for state in states.iter().flatten() {
            let run = |sum: &mut Self| -> Outcome<()> {
                let Sent { model, sums } = serde_json::from_slice(state)
                    .map_err(|error| FleetError::Learning(format!("{NAME}: {error}")))?;
                let loaded = sum.models.model(&model)?;
                let expected = with_hmm!(loaded.model, hmm => Expected::from_sums(hmm, sums)?);
                sum.add(&model, &loaded.model, expected)
            };
            run(self).map_err(|error| DataFusionError::External(Box::new(error)))?;
        }
        Ok(())
    }

    fn state(&mut self) -> Result<Vec<ScalarValue>> {
        Ok(vec![self.json()?])
    }

    fn evaluate(&mut self) -> Result<ScalarValue> {
        self.json()
    }

    fn size(&self) -> usize {
        let numbers = self.known.as_ref().map_or(0, |(_, sum)| sum.numbers());
        size_of::<Self>() + numbers * size_of::<f64>()
    }
}
