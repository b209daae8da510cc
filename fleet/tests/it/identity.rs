//! A run only continues with the input that its parts were made from.

use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::thread;

use wayfix_fleet::output::{Table, Verb};
use wayfix_fleet::{FleetError, Job, learn, run};

use crate::kit::*;
use crate::resume::{interrupt, prepare};

/// Changes a byte, keeping size and time of the file.
fn change(path: &Path, at: u64, change: impl Fn(u8) -> u8) {
    let modified = fs::metadata(path).unwrap().modified().unwrap();
    let mut file = OpenOptions::new().read(true).write(true).open(path).unwrap();
    let mut byte = [0];
    file.seek(SeekFrom::Start(at)).unwrap();
    file.read_exact(&mut byte).unwrap();
    file.seek(SeekFrom::Start(at)).unwrap();
    file.write_all(&[change(byte[0])]).unwrap();
    file.set_modified(modified).unwrap();
}

#[test]
fn other_content_of_the_same_size_and_time_is_refused() {
    for form in ["long", "nested"] {
        let (folder, expected) = prepare(form);
        let job = interrupt(&folder);
        // A symbol in the first row group.
        change(&job.inputs[0], 2000, |byte| !byte);
        let error = go_on(&job).unwrap_err();
        assert!(matches!(error, FleetError::Changed { .. }), "{error:?}");
        let text = error.to_string();
        assert!(text.contains("drives.parquet: row group 0 (rows 0 to "), "{text}");
        // Nothing is lost by the refusal.
        change(&job.inputs[0], 2000, |byte| !byte);
        assert!(go_on(&job).unwrap().resumed > 0);
        assert!(fs::read(&job.output).unwrap() == expected);
        // Nor is the output mistaken for that of another input.
        assert_eq!(go_on(&job).unwrap().finished, 1);
        change(&job.inputs[0], 2000, |byte| !byte);
        let error = go_on(&job).unwrap_err().to_string();
        assert!(error.contains("exists; replace it with --force"), "{error}");
    }
}

#[test]
fn the_same_content_at_another_time_goes_on() {
    let (folder, expected) = prepare("nested");
    let job = interrupt(&folder);
    let copy = fs::read(&job.inputs[0]).unwrap();
    fs::remove_file(&job.inputs[0]).unwrap();
    fs::write(&job.inputs[0], copy).unwrap();
    let later = fs::metadata(&job.inputs[0]).unwrap().modified().unwrap()
        + std::time::Duration::from_secs(1000);
    File::options().append(true).open(&job.inputs[0]).unwrap().set_modified(later).unwrap();
    assert!(go_on(&job).unwrap().resumed > 0);
    assert!(fs::read(&job.output).unwrap() == expected);
}

/// A table as text, with the symbol of one drive changed.
fn text(drives: &Drives, changed: usize) -> String {
    let mut text = String::from("trace_id,step,observation\n");
    for (id, drive) in drives.iter().enumerate() {
        for (k, symbol) in drive.iter().enumerate() {
            let symbol = if id == changed { (symbol + 1) % 5 } else { *symbol };
            writeln!(text, "{id:04},{},{symbol}", step(k)).unwrap();
        }
    }
    text
}

#[test]
fn text_is_the_same_up_to_the_block_of_the_last_row() {
    let folder = Folder::new(&model(3));
    let drives = drives(33, 6000, 10, 60);
    let path = folder.path("drives.parquet.csv");
    fs::write(&path, text(&drives, usize::MAX)).unwrap();
    let modified = fs::metadata(&path).unwrap().modified().unwrap();
    let mut job = folder.job("drives.parquet.csv", "out.parquet", Verb::Smooth, Table::Steps);
    let stopped = job.clone();
    let stopped =
        thread::spawn(move || run(&stopped, |done| assert!(done.drives < 3000, "interrupted")));
    assert!(stopped.join().is_err());
    let write = |changed| {
        fs::write(&path, text(&drives, changed)).unwrap();
        File::options().append(true).open(&path).unwrap().set_modified(modified).unwrap();
    };
    for changed in [0, 1500] {
        write(changed);
        let error = go_on(&job).unwrap_err().to_string();
        assert!(error.contains("drives.parquet.csv: the block of 65536 bytes at byte "), "{error}");
    }
    // Not read yet: the result is that of the new contents.
    write(5900);
    assert!(go_on(&job).unwrap().resumed > 0);
    let went_on = fs::read(&job.output).unwrap();
    job.output = folder.path("whole.parquet");
    assert_eq!(go_on(&job).unwrap().resumed, 0);
    assert!(fs::read(&job.output).unwrap() == went_on);
}

/// A run whose input is changed once it has begun.
fn changed_meanwhile(job: &Job) -> FleetError {
    let mut is_changed = false;
    run(job, |done| {
        if done.rows > 0 && !is_changed {
            is_changed = true;
            let length = fs::metadata(&job.inputs[0]).unwrap().len();
            let mut file = OpenOptions::new().write(true).open(&job.inputs[0]).unwrap();
            file.seek(SeekFrom::Start(length / 2)).unwrap();
            file.write_all(&[1]).unwrap();
            let now = std::time::SystemTime::now() + std::time::Duration::from_secs(9);
            file.set_modified(now).unwrap();
        }
    })
    .unwrap_err()
}

#[test]
fn a_change_while_it_is_read_ends_the_run() {
    let (folder, _) = prepare("long");
    let job = folder.job("drives.parquet", "out.parquet", Verb::Smooth, Table::Steps);
    let error = changed_meanwhile(&job);
    assert!(matches!(error, FleetError::Changed { .. }), "{error:?}");
    assert!(error.to_string().contains("was written to while it was read"), "{error}");
    assert!(!job.output.exists());
}

#[test]
fn learning_goes_on_with_the_same_content_only() {
    let folder = Folder::new(&model(11));
    let some = drives(12, 1500, 0, 30);
    folder.write("long.parquet", &long(&some), 3000);
    let job = learn_job(&folder, "long.parquet", "a.json", 2);
    let stop = |at: usize| {
        let stopped = job.clone();
        thread::spawn(move || learn(&stopped, |k, _| assert!(k < at, "interrupted"))).join()
    };
    assert!(stop(3).is_err());
    change(&job.input, 2000, |byte| !byte);
    let error = learn(&job, |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("another model, input, prior"), "{error}");
    change(&job.input, 2000, |byte| !byte);
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(1000);
    File::options().append(true).open(&job.input).unwrap().set_modified(later).unwrap();
    let mut first = None;
    learn(&job, |iteration, _| _ = first.get_or_insert(iteration)).unwrap();
    assert_eq!(first, Some(3));

    // Between two iterations.
    let job = learn_job(&folder, "long.parquet", "b.json", 2);
    let mut is_changed = false;
    let done = learn(&job, |iteration, _| {
        if iteration == 2 && !is_changed {
            is_changed = true;
            // A plain value, so that only the hash can tell.
            folder.write("long.parquet", &long(&drives(13, 1500, 0, 30)), 3000);
        }
    });
    let error = done.unwrap_err();
    assert!(matches!(error, FleetError::Changed { .. }), "{error:?}");
}
