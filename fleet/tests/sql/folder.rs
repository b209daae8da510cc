//! Models of a folder: queries see nothing outside it.

use std::fs;
use std::path::Path;

use wayfix_fleet::sql::Query;

use crate::kit::*;
use crate::tables::*;

fn query(folder: &Folder, name: &str) -> Query {
    let sql = format!("SELECT wayfix_score('{name}', observation) FROM drives");
    let mut query = over(folder, "drives.parquet", &[], &sql);
    query.models = Some(folder.path("models"));
    query
}

#[test]
fn no_file_outside_can_be_named() {
    let folder = Folder::new(&model(1));
    folder.write("drives.parquet", &nested(&drives(3, 20, 1, 9)), 10);
    fs::create_dir_all(folder.path("models/city")).unwrap();
    fs::create_dir_all(folder.path("models-2")).unwrap();
    for copy in ["models/a.json", "models/city/b.json", "models-2/c.json"] {
        fs::copy(folder.path("model.json"), folder.path(copy)).unwrap();
    }
    // A file outside has been read before, by a query without a folder.
    let outside = folder.path("model.json").to_str().unwrap().to_owned();
    rows(&Query { models: None, ..query(&folder, &outside) });

    let inside = folder.path("models/a.json").to_str().unwrap().to_owned();
    for name in ["a.json", "city/b.json", "city/../a.json", &inside] {
        rows(&query(&folder, name));
    }
    let mut refused = vec![
        outside.as_str(),
        "../model.json",
        "city/../../model.json",
        "../models-2/c.json",
        "../none.json",
        "..",
        "/etc/passwd",
        "/etc/none",
        "/etc/passwd/none",
        "/dev/zero",
        "none.json",
        "a.json/b",
    ];
    #[cfg(unix)]
    {
        use std::os::unix::fs::symlink;
        symlink("../model.json", folder.path("models/out.json")).unwrap();
        symlink("/etc", folder.path("models/etc")).unwrap();
        symlink("../city/b.json", folder.path("models/city/within.json")).unwrap();
        symlink("../models", folder.path("models/again")).unwrap();
        refused.extend(["out.json", "etc/passwd", "etc/none", "etc"]);
        rows(&query(&folder, "city/within.json"));
        rows(&query(&folder, "again/a.json"));
    }
    fs::remove_file(folder.path("rows.parquet")).unwrap();
    for name in refused {
        let message = error(&query(&folder, name)).to_string();
        let expected = format!(
            "wayfix_score: {name}: is not one of the models, expected the name of a file in their \
             folder"
        );
        assert!(message.contains(&expected), "{message}");
    }
    // A subfolder is not a model, and the folder of models must be a folder.
    let message = error(&query(&folder, "city")).to_string();
    assert!(message.contains("is not a file"), "{message}");
    for name in ["none", "model.json"] {
        let query = Query { models: Some(folder.path(name)), ..query(&folder, "a.json") };
        let message = error(&query).to_string();
        assert!(message.contains(Path::new(name).to_str().unwrap()), "{message}");
    }
}
