//! Models named by queries, and the cache of those this process has read.

use std::collections::{HashMap, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use arrow::datatypes::Schema;

use crate::error::{FleetError, Outcome};
use crate::input::{ColumnNames, Layout};
use crate::model::Model;

/// Maximum number of models in the cache; beyond it, the one read first is dropped.
const MOST: usize = 16;
/// Number of digits of a hash.
const DIGITS: usize = 32;

/// A cached model, with the layouts of its arguments.
#[derive(Debug)]
pub(super) struct Loaded {
    pub(super) model: Model,
    layouts: Mutex<HashMap<Arc<Schema>, Arc<Layout>>>,
}

impl Loaded {
    /// Layout for arguments of these types, determined once.
    pub(super) fn layout(&self, schema: &Arc<Schema>, names: &ColumnNames) -> Outcome<Arc<Layout>> {
        let mut layouts = self.layouts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(layout) = layouts.get(schema) {
            return Ok(layout.clone());
        }
        let layout = Arc::new(Layout::nested(schema, names, self.model.sensor())?);
        layouts.insert(schema.clone(), layout.clone());
        Ok(layout)
    }
}

/// Models by folder and name, in the order they were read.
type Read = VecDeque<(Models, String, Arc<Loaded>)>;

static READ: LazyLock<Mutex<Read>> = LazyLock::new(Mutex::default);

/// Files that queries may name as models: by default, all that the process can read.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Models {
    /// Folder, as a canonical path.
    folder: Option<PathBuf>,
}

impl Models {
    /// The files of a folder and its subfolders: names are relative to it, and links are followed
    /// if they lead to files inside. Everything outside looks as if it did not exist.
    ///
    /// Whoever can write to the folder can still change it between two looks; this guards against
    /// those who write queries.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if this is not a folder.
    pub fn in_folder(folder: &Path) -> Outcome<Self> {
        let known = fs::canonicalize(folder).map_err(FleetError::file(folder))?;
        if !known.is_dir() {
            return Err(FleetError::format(folder, "is not a folder, expected that of the models"));
        }
        Ok(Self { folder: Some(known) })
    }

    /// Path of the file with a name.
    pub(super) fn path(&self, name: &str) -> Outcome<PathBuf> {
        let Some(folder) = &self.folder else { return Ok(PathBuf::from(name)) };
        // The same message whether a file outside exists or not, or it would tell which files there
        // are.
        match fs::canonicalize(folder.join(name)) {
            Ok(path) if path.starts_with(folder) => Ok(path),
            _ => {
                let message =
                    "is not one of the models, expected the name of a file in their folder";
                Err(FleetError::format(Path::new(name), message))
            }
        }
    }

    /// Returns the model with a name, a path or `path#hash`; reads its file unless that was done
    /// before.
    ///
    /// # Errors
    ///
    /// [`FleetError`] if the file cannot be read, is not a model, or has another hash.
    pub(super) fn model(&self, name: &str) -> Outcome<Arc<Loaded>> {
        // The lock is held while the file is read: tasks that need the same model wait instead of
        // reading it again.
        let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
        let found = read.iter().find(|(models, known, _)| known == name && models == self);
        if let Some((_, _, loaded)) = found {
            return Ok(loaded.clone());
        }
        let (path, hash) = split(name);
        let model = Model::load(&self.path(path)?)?;
        if let Some(hash) = hash
            && !hash.eq_ignore_ascii_case(model.hash())
        {
            let message = format!("has the hash {}, expected {hash}", model.hash());
            return Err(FleetError::format(Path::new(path), message));
        }
        let loaded = Arc::new(Loaded { model, layouts: Mutex::default() });
        if read.len() == MOST {
            read.pop_front();
        }
        read.push_back((self.clone(), name.to_owned(), loaded.clone()));
        Ok(loaded)
    }
}

/// Path and hash of a name; a `#` that is not followed by a hash belongs to the path.
pub(super) fn split(name: &str) -> (&str, Option<&str>) {
    let is_hash =
        |end: &str| end.len() == DIGITS && end.bytes().all(|byte| byte.is_ascii_hexdigit());
    match name.rsplit_once('#') {
        Some((path, hash)) if is_hash(hash) => (path, Some(hash)),
        _ => (name, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    #[test]
    fn a_name_may_end_with_a_hash() {
        let hash = "0123456789abcdef0123456789ABCDEF";
        assert_eq!(split(&format!("a#b.json#{hash}")), ("a#b.json", Some(hash)));
        assert_eq!(split("a#b.json"), ("a#b.json", None));
        assert_eq!(split("a.json#0123"), ("a.json#0123", None));
    }

    #[test]
    fn a_model_is_read_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.json");
        let hmm = wayfix::Hmm::new(
            wayfix::Prior::AtFirstObservation(wayfix::Belief::uniform(2).unwrap()),
            wayfix::DenseTransition::from_rows(&[[0.5, 0.5], [0.5, 0.5]]).unwrap(),
            wayfix::TableLikelihood::from_rows(&[vec![0.5, 0.5], vec![0.25, 0.75]]).unwrap(),
        );
        fs::write(&path, serde_json::to_vec(&hmm.unwrap()).unwrap()).unwrap();
        let name = path.to_str().unwrap();
        let model = |name: &str| Models::default().model(name);
        let read = || model(name).unwrap();
        let first = thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(read)).collect();
            let all: Vec<_> = threads.into_iter().map(|thread| thread.join().unwrap()).collect();
            assert!(all.windows(2).all(|pair| Arc::ptr_eq(&pair[0], &pair[1])));
            all[0].clone()
        });
        let hash = first.model.hash().to_owned();
        let with_hash = model(&format!("{name}#{hash}")).unwrap();
        assert_eq!(with_hash.model.hash(), hash);
        let other = format!("{name}#{}", "0".repeat(DIGITS));
        let message = model(&other).unwrap_err().to_string();
        assert!(message.contains(&format!("has the hash {hash}, expected 0000")), "{message}");
        // A name that has been read is not read again.
        fs::remove_file(&path).unwrap();
        assert!(Arc::ptr_eq(&first, &read()));
        assert!(model(&other).is_err());
    }
}
