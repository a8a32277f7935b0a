//! Secrets as an orchestrator mounts them.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use super::folder::Folder;

/// A secret in a folder as Kubernetes mounts it: each file is a link through the link `..data`, which is swapped.
pub(crate) struct Mounted {
    folder: Folder,
    versions: AtomicUsize,
}

impl Mounted {
    pub(crate) fn new(test: &str, contents: &[(&str, &str)]) -> Self {
        let mounted = Self { folder: Folder::new(test), versions: AtomicUsize::new(0) };
        mounted.swap(contents);
        for (name, _) in contents {
            symlink(Path::new("..data").join(name), mounted.path(name)).unwrap();
        }
        mounted
    }

    /// Where the program finds a file.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path(name)
    }

    /// Puts these contents in the place of all before them, at once.
    pub(crate) fn swap(&self, contents: &[(&str, &str)]) {
        let version = format!("..version-{}", self.versions.fetch_add(1, Ordering::Relaxed));
        fs::create_dir(self.path(&version)).unwrap();
        for (name, text) in contents {
            fs::write(self.path(&version).join(name), text).unwrap();
        }
        symlink(&version, self.path("..new")).unwrap();
        fs::rename(self.path("..new"), self.path("..data")).unwrap();
    }
}
