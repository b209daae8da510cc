//! Plans that can be run over the ranges of one sorted table, one range after the other.
//!
//! Such a plan makes each of its rows from the rows of one drive, and keeps their order: then its
//! rows over the whole table are those over the first range, followed by those over the next one.
//! All else is refused by its name rather than guessed at.

use std::ops::ControlFlow;

use datafusion::common::tree_node::{TreeNode, TreeNodeRecursion};
use datafusion::common::{DFSchema, Result};
use datafusion::logical_expr::utils::merge_schema;
use datafusion::logical_expr::{Expr, LogicalPlan, Volatility};
use datafusion::scalar::ScalarValue;

use super::unordered::OURS;

/// Columns of a node that are the first column that the table is sorted by, or what needs other
/// rows.
type Keys = ControlFlow<String, Vec<usize>>;

/// What prevents that a plan is run by ranges of a table that is sorted by `key`, in words.
pub(super) fn obstacle(plan: &LogicalPlan, table: &str, key: &str) -> Option<String> {
    keys(plan, table, key).break_value()
}

/// Names of the models of a plan.
pub(super) fn models(plan: &LogicalPlan) -> Result<Vec<String>> {
    let mut names = Vec::new();
    plan.apply_with_subqueries(|node| {
        node.apply_expressions(|expression| {
            expression.apply(|expression| {
                let (name, arguments) = match expression {
                    Expr::ScalarFunction(function) => (function.name(), &function.args),
                    Expr::AggregateFunction(function) => {
                        (function.func.name(), &function.params.args)
                    }
                    _ => return Ok(TreeNodeRecursion::Continue),
                };
                if name.starts_with(OURS)
                    && let Some(Expr::Literal(model, _)) = arguments.first()
                    && let Some(Some(model)) = ScalarValue::try_as_str(model)
                    && !names.iter().any(|name| name == model)
                {
                    names.push(model.to_owned());
                }
                Ok(TreeNodeRecursion::Continue)
            })
        })
    })?;
    names.sort();
    Ok(names)
}

fn keys(plan: &LogicalPlan, table: &str, key: &str) -> Keys {
    let inputs = plan.inputs();
    let below = match inputs[..] {
        [] => Vec::new(),
        [input] => keys(input, table, key)?,
        _ => return ControlFlow::Break(format!("{} reads several tables", name(plan))),
    };
    let schema = merge_schema(&inputs);
    if let Some(reason) = unfit(plan) {
        return ControlFlow::Break(reason);
    }
    let is_key = |expression: &Expr| is_column(expression, &schema, &below);
    match plan {
        LogicalPlan::TableScan(scan)
            if scan.table_name.table() == table && scan.fetch.is_none() =>
        {
            let fields = scan.projected_schema.fields().iter().enumerate();
            let found = fields.filter(|(_, field)| field.name() == key).map(|(index, _)| index);
            ControlFlow::Continue(found.collect())
        }
        LogicalPlan::SubqueryAlias(_) | LogicalPlan::Filter(_) => ControlFlow::Continue(below),
        LogicalPlan::Projection(projection) => {
            let kept = projection.expr.iter().enumerate().filter(|(_, e)| is_key(e));
            ControlFlow::Continue(kept.map(|(index, _)| index).collect())
        }
        LogicalPlan::Unnest(unnest) => {
            let from = unnest.dependency_indices.iter().enumerate();
            let kept = from.filter(|(_, from)| below.contains(from)).map(|(index, _)| index);
            ControlFlow::Continue(kept.collect())
        }
        LogicalPlan::Aggregate(aggregate) => {
            let groups = aggregate.group_expr.iter().enumerate();
            let kept: Vec<usize> = groups.filter(|(_, e)| is_key(e)).map(|(i, _)| i).collect();
            if kept.is_empty() {
                let reason = format!("{} has groups of more than one `{key}`", name(plan));
                return ControlFlow::Break(reason);
            }
            ControlFlow::Continue(kept)
        }
        LogicalPlan::Sort(sort) => {
            let first = sort.expr.first().filter(|first| first.asc && is_key(&first.expr));
            if first.is_some() && sort.fetch.is_none() {
                return ControlFlow::Continue(below);
            }
            ControlFlow::Break(format!("{} needs all rows", name(plan)))
        }
        _ => ControlFlow::Break(format!("{} needs other rows", name(plan))),
    }
}

/// An expression that gives something else for a part of the rows, or at another time.
fn unfit(plan: &LogicalPlan) -> Option<String> {
    let mut found = None;
    let looked = plan.apply_expressions(|expression| {
        expression.apply(|expression| {
            found = match expression {
                Expr::ScalarSubquery(_)
                | Expr::Exists(_)
                | Expr::InSubquery(_)
                | Expr::SetComparison(_) => Some("a subquery reads other rows".to_owned()),
                Expr::ScalarFunction(function)
                    if function.func.signature().volatility != Volatility::Immutable
                        && !function.name().starts_with(OURS) =>
                {
                    Some(format!("{} depends on the moment", function.name()))
                }
                _ => None,
            };
            Ok(if found.is_some() { TreeNodeRecursion::Stop } else { TreeNodeRecursion::Continue })
        })
    });
    looked.err().map(|error| error.to_string()).or(found)
}

/// Returns true for one of some columns, also under another name.
fn is_column(expression: &Expr, schema: &DFSchema, columns: &[usize]) -> bool {
    match expression {
        Expr::Alias(alias) => is_column(&alias.expr, schema, columns),
        Expr::Column(column) => {
            schema.maybe_index_of_column(column).is_some_and(|index| columns.contains(&index))
        }
        _ => false,
    }
}

/// First words of a node.
fn name(plan: &LogicalPlan) -> String {
    let text = plan.display().to_string();
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("`{} …`", &text[..end]),
        None => format!("`{text}`"),
    }
}
