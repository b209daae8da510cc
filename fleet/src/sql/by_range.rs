//! Plans that can be run over the ranges of one sorted table, one range after another.
//!
//! Such a plan makes each row from the rows of one drive, and keeps their order. Then its rows over
//! the whole table are those over the first range, followed by those over the next, and so on.
//! Whether this holds is shown by induction over the nodes from the table upwards, tracking which
//! output columns are copies of the key; any node not known to preserve it is refused by name.

use std::ops::ControlFlow;

use datafusion::common::tree_node::{TreeNode, TreeNodeRecursion};
use datafusion::common::{DFSchema, Result};
use datafusion::logical_expr::utils::merge_schema;
use datafusion::logical_expr::{Expr, LogicalPlan, Volatility};
use datafusion::scalar::ScalarValue;

use super::unordered::OURS;

/// Indices of the columns of a node that hold the key, the first column that the table is sorted
/// by; or what needs other rows.
type Keys = ControlFlow<String, Vec<usize>>;

/// Returns what prevents running a plan by ranges of a table sorted by `key`, in words.
pub(super) fn obstacle(plan: &LogicalPlan, table: &str, key: &str) -> Option<String> {
    keys(plan, table, key).break_value()
}

/// Names of the models in a plan.
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
        // These work row by row and keep the columns.
        LogicalPlan::SubqueryAlias(_) | LogicalPlan::Filter(_) => ControlFlow::Continue(below),
        LogicalPlan::Projection(projection) => {
            let kept = projection.expr.iter().enumerate().filter(|(_, e)| is_key(e));
            ControlFlow::Continue(kept.map(|(index, _)| index).collect())
        }
        // One row becomes several, next to one another.
        LogicalPlan::Unnest(unnest) => {
            let from = unnest.dependency_indices.iter().enumerate();
            let kept = from.filter(|(_, from)| below.contains(from)).map(|(index, _)| index);
            ControlFlow::Continue(kept.collect())
        }
        LogicalPlan::Aggregate(aggregate) => {
            let groups = aggregate.group_expr.iter().enumerate();
            let kept: Vec<usize> = groups.filter(|(_, e)| is_key(e)).map(|(i, _)| i).collect();
            // With the key among the groups, a group lies within one drive, and so within one
            // range. Groups come in the order of the sorted input.
            if kept.is_empty() {
                let reason = format!("{} groups rows of different `{key}`", name(plan));
                return ControlFlow::Break(reason);
            }
            ControlFlow::Continue(kept)
        }
        LogicalPlan::Sort(sort) => {
            let first = sort.expr.first().filter(|first| first.asc && is_key(&first.expr));
            // Sorting by the key first only moves rows within a drive.
            if first.is_some() && sort.fetch.is_none() {
                return ControlFlow::Continue(below);
            }
            ControlFlow::Break(format!("{} needs all rows", name(plan)))
        }
        _ => ControlFlow::Break(format!("{} needs other rows", name(plan))),
    }
}

/// Returns why an expression of a node would have another value over part of the rows, or at
/// another time.
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
                        // Ours are declared stable because a model file may change; here the hashes
                        // of models are in the settings.
                        && !function.name().starts_with(OURS) =>
                {
                    Some(format!("{} depends on when it is called", function.name()))
                }
                _ => None,
            };
            Ok(if found.is_some() { TreeNodeRecursion::Stop } else { TreeNodeRecursion::Continue })
        })
    });
    looked.err().map(|error| error.to_string()).or(found)
}

/// True for one of `columns`, possibly under another name.
fn is_column(expression: &Expr, schema: &DFSchema, columns: &[usize]) -> bool {
    match expression {
        Expr::Alias(alias) => is_column(&alias.expr, schema, columns),
        Expr::Column(column) => {
            schema.maybe_index_of_column(column).is_some_and(|index| columns.contains(&index))
        }
        _ => false,
    }
}

/// First words of a node, for messages.
fn name(plan: &LogicalPlan) -> String {
    let text = plan.display().to_string();
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("`{} …`", &text[..end]),
        None => format!("`{text}`"),
    }
}
