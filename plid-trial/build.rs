//! Tells the crate of which commit it is built, and whether anything differs from it.

use std::path::Path;
use std::process::Command;

fn main() {
    // Not `env!`: two clones with one target folder share the compiled script, and each has its own commit.
    let package = std::env::var("CARGO_MANIFEST_DIR").expect("set by Cargo");
    let root = Path::new(&package).join("..");
    let git = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(&root).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    // Outside a repository, as in a published crate, there is no commit to tell of.
    if let (Some(commit), Some(changed)) = (git(&["rev-parse", "HEAD"]), git(&["status", "--porcelain", "-uno"])) {
        println!("cargo::rustc-env=PLID_COMMIT={commit}");
        println!("cargo::rustc-env=PLID_CHANGED={}", !changed.is_empty());
    }
    for name in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--path-format=absolute", "--git-path", name]) {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    let members = std::fs::read_dir(&root).into_iter().flatten().flatten();
    for sources in members.map(|entry| entry.path().join("src")).chain([root.join("src")]).filter(|path| path.is_dir())
    {
        println!("cargo::rerun-if-changed={}", sources.display());
    }
}
