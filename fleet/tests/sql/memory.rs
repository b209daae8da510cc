//! Memory of a query does not grow with the file.
#![cfg(target_os = "linux")]

use std::process::Command;

use crate::kit::*;
use crate::tables::model_of;

/// Peak memory of the command, in bytes.
fn peak(folder: &Folder, input: &str, order: &str, sql: &str) -> u64 {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
    command.args(["sql", "--force", "--threads", "2", "--order", order, "--query", sql]);
    // Small enough that even the smaller table has several parts in flight.
    command.args(["--part", "100000"]);
    command.arg("--table").arg(format!("drives={}", folder.path(input).display()));
    command.arg("--output").arg(folder.path(&format!("{input}.out")));
    peak_memory(&mut command)
}

#[test]
fn is_flat() {
    let folder = Folder::new(&model(2));
    let model = model_of(&folder);
    let some = drives(22, 20_000, 40, 60);
    let many: Drives = some.iter().cycle().take(80_000).cloned().collect();
    folder.write("few.parquet", &nested(&some), 4000);
    folder.write("many.parquet", &nested(&many), 4000);
    let sql = format!("SELECT trace_id, wayfix_smooth({model}, observation) FROM drives");
    let few = peak(&folder, "few.parquet", "trace_id", &sql);
    let most = peak(&folder, "many.parquet", "trace_id", &sql);
    assert!(few > 5 << 20, "{few}");
    // Results of the additional steps would take 80 MB.
    assert!(most < few + (30 << 20), "{few} bytes, then {most}");

    folder.write("few.parquet", &long(&some[..5000]), 100_000);
    folder.write("many.parquet", &long(&some), 100_000);
    let sql = format!(
        "SELECT trace_id, wayfix_smooth({model}, array_agg(observation ORDER BY step)) FROM drives \
         GROUP BY trace_id"
    );
    let few = peak(&folder, "few.parquet", "trace_id,step", &sql);
    let most = peak(&folder, "many.parquet", "trace_id,step", &sql);
    // Scalars of the additional steps would take 100 MB.
    assert!(most < few + (30 << 20), "{few} bytes, then {most}");
}
