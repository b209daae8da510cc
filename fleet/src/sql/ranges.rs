//! Ranges of a sorted table, each of whole drives, that queries can take one by one.
//!
//! A range is a condition on the first key column, over the files that contain its rows. So it
//! travels wherever a plan travels, to the executors of a cluster, too, and the reader of a file
//! skips row groups outside the range by their statistics.

use std::sync::Arc;

use datafusion::common::tree_node::{Transformed, TransformedResult, TreeNode};
use datafusion::common::{Column, Result};
use datafusion::datasource::listing::{ListingTable, ListingTableConfig, ListingTableUrl};
use datafusion::datasource::{provider_as_source, source_as_provider};
use datafusion::logical_expr::{Expr, LogicalPlan, LogicalPlanBuilder, TableScan, lit};
use datafusion::scalar::ScalarValue;

use super::files::Files;
use super::source::Source;

/// Rows of a sorted table with `from` ≤ key < `to`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Range {
    pub(super) from: Option<ScalarValue>,
    pub(super) to: Option<ScalarValue>,
    /// Numbers of the rows.
    pub(super) rows: std::ops::Range<u64>,
}

impl Range {
    /// The plan over only these rows of the table.
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
        // Only the files with rows of this range: if a drive continues in the next file, DataFusion
        // cannot tell the order of several files.
        if let Some(table) = source_as_provider(&scan.source)?.downcast_ref::<ListingTable>() {
            let urls = files.with_rows(&self.rows).map(ListingTableUrl::parse);
            let config = ListingTableConfig::new_with_multi_paths(urls.collect::<Result<_>>()?)
                .with_listing_options(table.options().clone())
                .with_schema(scan.source.schema());
            scan.source = provider_as_source(Arc::new(ListingTable::try_new(config)?));
        }
        let column = Expr::Column(Column::new(Some(scan.table_name.clone()), key));
        let of = scan.source.schema().field_with_name(key)?.data_type().clone();
        // The scan may read the key as another type than the check did (a string view, say), and a
        // cast on the column would defeat the statistics.
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
