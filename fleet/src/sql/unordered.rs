//! Refuses drives that are gathered without an order.

use datafusion::common::config::ConfigOptions;
use datafusion::common::tree_node::{TreeNode, TreeNodeRecursion};
use datafusion::common::{Column, DFSchema, Result, plan_err};
use datafusion::logical_expr::utils::merge_schema;
use datafusion::logical_expr::{Distinct, Expr, ExprSchemable, LogicalPlan};
use datafusion::optimizer::AnalyzerRule;

/// Prefix of the names of our functions.
pub(super) const OURS: &str = "wayfix_";

/// Rule that refuses functions over lists gathered by `array_agg` without `ORDER BY`: their results
/// would be those of drives that never happened, and nobody would notice.
///
/// It also refuses them over sorted tables: threads that gather pieces of a drive put them together
/// in any order, and an `ORDER BY` costs nothing where the order is known.
#[derive(Debug)]
pub(super) struct Unordered;

impl AnalyzerRule for Unordered {
    fn name(&self) -> &'static str {
        "wayfix_unordered"
    }

    fn analyze(&self, plan: LogicalPlan, _: &ConfigOptions) -> Result<LogicalPlan> {
        plan.apply_with_subqueries(|node| {
            node.apply_expressions(|expression| {
                expression.apply(|expression| {
                    check(expression, node)?;
                    Ok(TreeNodeRecursion::Continue)
                })
            })
        })?;
        Ok(plan)
    }
}

/// Checks an expression of a node, if it is one of our functions.
fn check(expression: &Expr, node: &LogicalPlan) -> Result<()> {
    let (name, arguments) = match expression {
        Expr::ScalarFunction(function) => (function.name(), &function.args),
        Expr::AggregateFunction(function) => (function.func.name(), &function.params.args),
        _ => return Ok(()),
    };
    if !name.starts_with(OURS) {
        return Ok(());
    }
    let inputs = merge_schema(&node.inputs());
    // The first one is the model.
    for argument in arguments.iter().skip(1) {
        if let Some(gathered) = unordered(argument, node, &inputs)? {
            let fix = gathered.strip_suffix(')').unwrap_or(&gathered);
            return plan_err!(
                "{name}: {gathered} has no ORDER BY, so the steps of a drive come in any order; \
                 expected one, such as {fix} ORDER BY step)"
            );
        }
    }
    Ok(())
}

/// Traces the lists of an expression back to an `array_agg` without an order, and returns it.
fn unordered(expression: &Expr, node: &LogicalPlan, inputs: &DFSchema) -> Result<Option<String>> {
    // A number derived from a list, such as its length, does not carry the steps.
    if !expression.get_type(inputs).is_ok_and(|of| of.is_nested()) {
        return Ok(None);
    }
    let gathers = |name: &str| matches!(name, "array_agg" | "list_agg");
    match expression {
        Expr::Column(column) => return of_inputs(column, node),
        Expr::AggregateFunction(function) if gathers(function.func.name()) => {
            let is_unordered = function.params.order_by.is_empty();
            return Ok(is_unordered.then(|| expression.to_string()));
        }
        Expr::WindowFunction(function) if gathers(function.fun.name()) => {
            let is_unordered = function.params.order_by.is_empty();
            let arguments = function.params.args.iter().map(ToString::to_string);
            let arguments = arguments.collect::<Vec<_>>().join(", ");
            return Ok(is_unordered.then(|| format!("{}({arguments})", function.fun.name())));
        }
        // The list is sorted afterwards, in an order that the user chose.
        Expr::ScalarFunction(function) if matches!(function.name(), "array_sort" | "list_sort") => {
            return Ok(None);
        }
        _ => {}
    }
    let mut found = None;
    expression.apply_children(|child| {
        found = unordered(child, node, inputs)?;
        Ok(if found.is_some() { TreeNodeRecursion::Stop } else { TreeNodeRecursion::Continue })
    })?;
    Ok(found)
}

/// The same for a column of the inputs of a node.
fn of_inputs(column: &Column, node: &LogicalPlan) -> Result<Option<String>> {
    for input in node.inputs() {
        if let Some(index) = input.schema().maybe_index_of_column(column) {
            return of_output(input, index);
        }
    }
    Ok(None)
}

/// The same for an output column of a node.
fn of_output(node: &LogicalPlan, index: usize) -> Result<Option<String>> {
    let computed = match node {
        LogicalPlan::Projection(projection) => projection.expr.get(index),
        LogicalPlan::Aggregate(aggregate) => {
            // Groups come first; with grouping sets there are more columns than expressions.
            let groups = aggregate.schema.fields().len() - aggregate.aggr_expr.len();
            match index.checked_sub(groups) {
                Some(index) => aggregate.aggr_expr.get(index),
                None => aggregate.group_expr.get(index),
            }
        }
        LogicalPlan::Window(window) => {
            let before = window.input.schema().fields().len();
            match index.checked_sub(before) {
                Some(index) => window.window_expr.get(index),
                None => return of_output(&window.input, index),
            }
        }
        LogicalPlan::Distinct(Distinct::On(distinct)) => distinct.select_expr.get(index),
        LogicalPlan::SubqueryAlias(alias) => return of_output(&alias.input, index),
        LogicalPlan::Union(union) => {
            for input in &union.inputs {
                if let Some(found) = of_output(input, index)? {
                    return Ok(Some(found));
                }
            }
            return Ok(None);
        }
        _ => {
            // All other nodes pass columns on under their names.
            let column = Column::from(node.schema().qualified_field(index));
            return of_inputs(&column, node);
        }
    };
    let inputs = merge_schema(&node.inputs());
    computed.map_or(Ok(None), |expression| unordered(expression, node, &inputs))
}
