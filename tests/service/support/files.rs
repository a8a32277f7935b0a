//! Files of a test, and secrets as an orchestrator mounts them.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A folder of one test, removed with it.
pub(crate) struct Files(PathBuf);

impl Files {
    pub(crate) fn new(test: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("slipdrive-{test}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).unwrap();
        path
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        // What stays in a temporary folder does no harm.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A secret in a folder as Kubernetes mounts it: each file is a link through the link `..data`, which is swapped.
#[cfg(unix)]
pub(crate) struct Mounted {
    files: Files,
    versions: AtomicUsize,
}

#[cfg(unix)]
impl Mounted {
    pub(crate) fn new(test: &str, contents: &[(&str, &str)]) -> Self {
        let mounted = Self { files: Files::new(test), versions: AtomicUsize::new(0) };
        mounted.swap(contents);
        for (name, _) in contents {
            std::os::unix::fs::symlink(Path::new("..data").join(name), mounted.path(name)).unwrap();
        }
        mounted
    }

    /// Where the program finds a file.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.files.path(name)
    }

    /// Puts these contents in the place of all before them, at once.
    pub(crate) fn swap(&self, contents: &[(&str, &str)]) {
        let version = format!("..version-{}", self.versions.fetch_add(1, Ordering::Relaxed));
        fs::create_dir(self.path(&version)).unwrap();
        for (name, text) in contents {
            fs::write(self.path(&version).join(name), text).unwrap();
        }
        std::os::unix::fs::symlink(&version, self.path("..new")).unwrap();
        fs::rename(self.path("..new"), self.path("..data")).unwrap();
    }
}
