//! Memory does not grow with the file.
#![cfg(target_os = "linux")]

use std::process::Command;

use crate::kit::*;

/// Peak memory of the command, in bytes.
fn peak(folder: &Folder, input: &str) -> u64 {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wayfix-fleet"));
    command.args(["smooth", "--quiet", "--threads", "2", "--part", "50000"]);
    command.arg("--model").arg(folder.path("model.json"));
    command.arg("--input").arg(folder.path(input));
    command.arg("--output").arg(folder.path(&format!("{input}.out")));
    peak_memory(&mut command)
}

#[test]
fn is_flat() {
    let folder = Folder::new(&model(2));
    let some = drives(22, 30_000, 40, 60);
    folder.write("few.parquet", &nested(&some[..15_000]), 4000);
    let many: Drives = some.iter().cycle().take(120_000).cloned().collect();
    folder.write("many.parquet", &nested(&many), 4000);
    let (few, many) = (peak(&folder, "few.parquet"), peak(&folder, "many.parquet"));
    assert!(few > 5 << 20, "{few}");
    // Results of the additional steps would take 160 MB.
    assert!(many < few + (60 << 20), "{few} bytes, then {many}");
}
