//! Ranges of a sorted table, each of whole drives, which queries can take one by one.
//!
//! A range is a condition on the first column that the table is sorted by, over the files that have
//! its rows. So it goes wherever a plan goes, to the executors of a cluster too, and the reader of
//! a file skips the row groups that lie outside by their statistics.

use std::sync::Arc;

use datafusion::common::tree_node::{Transformed, TransformedResult, TreeNode};
use datafusion::common::{Column, Result};
use datafusion::datasource::listing::{ListingTable, ListingTableConfig, ListingTableUrl};
use datafusion::datasource::{provider_as_source, source_as_provider};
use datafusion::logical_expr::{Expr, LogicalPlan, LogicalPlanBuilder, TableScan, lit};
use datafusion::scalar::ScalarValue;

use super::files::Files;
use super::source::Source;

/// Rows of a sorted table whose key is not below one value, and below another.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Range {
    pub(super) from: Option<ScalarValue>,
    pub(super) to: Option<ScalarValue>,
    /// Numbers of the rows.
    pub(super) rows: std::ops::Range<u64>,
}

impl Range {
    /// The plan over these rows of a table alone.
    pub(super) fn of(
        &self,
        plan: LogicalPlan,
        source: &Source,
        files: &Files,
    ) -> Result<LogicalPlan> {
        let narrow = |node: LogicalPlan| match node {
            LogicalPlan::TableScan(scan) if scan.table_name.table() == source.name => {
                self.narrow(scan, &source.key[0], files).map(Transformed::yes)
            }
            other => Ok(Transformed::no(other)),
        };
        plan.transform_up(narrow).data()
    }

    fn narrow(&self, mut scan: TableScan, key: &str, files: &Files) -> Result<LogicalPlan> {
        // Of several files DataFusion knows no order if a drive goes on in the next one.
        if let Some(table) = source_as_provider(&scan.source)?.downcast_ref::<ListingTable>() {
            let urls = files.with_rows(&self.rows).map(ListingTableUrl::parse);
            let config = ListingTableConfig::new_with_multi_paths(urls.collect::<Result<_>>()?)
                .with_listing_options(table.options().clone())
                .with_schema(scan.source.schema());
            scan.source = provider_as_source(Arc::new(ListingTable::try_new(config)?));
        }
        let column = Expr::Column(Column::new(Some(scan.table_name.clone()), key));
        let of = scan.source.schema().field_with_name(key)?.data_type().clone();
        let bound = |value: &ScalarValue| value.cast_to(&of).map(lit);
        let from = self.from.as_ref().map(bound).transpose()?;
        let to = self.to.as_ref().map(bound).transpose()?;
        let from = from.map(|from| column.clone().gt_eq(from));
        let to = to.map(|to| column.lt(to));
        let scan = LogicalPlanBuilder::from(LogicalPlan::TableScan(scan));
        match from.into_iter().chain(to).reduce(Expr::and) {
            Some(condition) => scan.filter(condition)?.build(),
            None => scan.build(),
        }
    }
}
