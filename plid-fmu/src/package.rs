//! The archive, which is unpacked into a temporary folder.

use std::ffi::CString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use plid_file::Scratch;
use zip::ZipArchive;
use zip::result::ZipError;

use crate::FmuError;
use crate::description::{Fault, ModelDescription, Version};
use crate::native::{Binary, Birth};

/// An FMU that is unpacked and loaded.
pub(crate) struct Package {
    /// The path of the FMU as it was given, for messages.
    pub file: PathBuf,
    pub description: ModelDescription,
    pub binary: Arc<Binary>,
    pub birth: Birth,
    /// The folder of the binary and its resources, which is removed at the end.
    _folder: Scratch,
}

/// An FMU that is unpacked. None of its code has run.
pub(crate) struct Unpacked {
    pub description: ModelDescription,
    folder: Scratch,
}

impl Package {
    /// Loads an unpacked FMU.
    pub fn load(file: &Path, unpacked: Unpacked) -> Result<Self, FmuError> {
        let Unpacked { description, folder } = unpacked;
        let path = binary(file, folder.path(), &description)?;
        let binary = Binary::load(&path, description.version)
            .map_err(|message| FmuError::Binary { file: file.into(), message: message + description.tool() })?;
        let birth = birth(file, folder.path(), &description)?;
        Ok(Self { file: file.into(), description, binary: Arc::new(binary), birth, _folder: folder })
    }
}

/// Unpacks an FMU into a temporary folder, and reads its description.
pub(crate) fn unpack(file: &Path) -> Result<Unpacked, FmuError> {
    let io = |source: std::io::Error| FmuError::Io { file: file.into(), source };
    let damaged = |error: ZipError| match error {
        ZipError::Io(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => io(source),
        error => FmuError::Archive { file: file.into(), message: error.to_string() },
    };
    let wrong = |message: String| FmuError::Description { file: file.into(), message };
    let mut archive = ZipArchive::new(File::open(file).map_err(io)?).map_err(damaged)?;
    let folder = Scratch::new(&std::env::temp_dir(), "plid-fmu").map_err(io)?;
    archive.extract(folder.path()).map_err(damaged)?;
    let text = fs::read(folder.path().join("modelDescription.xml")).map_err(|error| wrong(error.to_string()))?;
    let text = String::from_utf8(text).map_err(|error| wrong(error.to_string()))?;
    let description = ModelDescription::parse(&text).map_err(|fault| match fault {
        Fault::Malformed(message) => wrong(message),
        Fault::Version(version) => FmuError::Version { file: file.into(), version },
        Fault::Kind(has) => FmuError::Kind { file: file.into(), has },
    })?;
    Ok(Unpacked { description, folder })
}

/// Returns the folders in which a binary for this machine may be.
fn platforms(version: Version, os: &str, arch: &str) -> Vec<String> {
    let system = if os == "macos" { "darwin" } else { os };
    let tuple = format!("{arch}-{system}");
    let short = match (os, arch) {
        ("linux", "x86_64") => "linux64",
        ("windows", "x86_64") => "win64",
        ("macos", "x86_64" | "aarch64") => "darwin64",
        _ => return vec![tuple],
    };
    match version {
        Version::Two => vec![short.into(), tuple],
        Version::Three => vec![tuple],
    }
}

/// Returns the file of the binary.
fn binary(file: &Path, folder: &Path, description: &ModelDescription) -> Result<PathBuf, FmuError> {
    let binaries = folder.join("binaries");
    let name = format!("{}{}", description.identifier, std::env::consts::DLL_SUFFIX);
    let all = platforms(description.version, std::env::consts::OS, std::env::consts::ARCH);
    let candidates = all.iter().map(|platform| binaries.join(platform).join(&name));
    if let Some(found) = candidates.into_iter().find(|path| path.is_file()) {
        return Ok(found);
    }
    let entries = fs::read_dir(&binaries).into_iter().flatten().flatten();
    let mut there: Vec<String> =
        entries.map(|entry| format!("binaries/{}", entry.file_name().to_string_lossy())).collect();
    there.sort();
    let found = if there.is_empty() { "no binaries".into() } else { there.join(", ") };
    let wanted = format!("binaries/{}/{name}", all.first().map_or("", String::as_str));
    Err(FmuError::Platform { file: file.into(), wanted, found })
}

fn birth(file: &Path, folder: &Path, description: &ModelDescription) -> Result<Birth, FmuError> {
    let of = |text: &str| {
        let message = format!("{text:?} contains a zero");
        CString::new(text).map_err(|_| FmuError::Description { file: file.into(), message })
    };
    let resources = folder.join("resources");
    let resources = resources.to_string_lossy();
    let place = match description.version {
        Version::Two => uri(&resources),
        Version::Three => format!("{resources}{}", std::path::MAIN_SEPARATOR),
    };
    Ok(Birth { name: of(&description.name)?, token: of(&description.token)?, resources: of(&place)? })
}

/// Returns the URI of a file.
fn uri(path: &str) -> String {
    let path = path.replace('\\', "/");
    let root = if path.starts_with('/') { "file://" } else { "file:///" };
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/-_.~:".contains(&byte);
    let encoded = path.bytes().map(|byte| if plain(byte) { char::from(byte).into() } else { format!("%{byte:02X}") });
    encoded.fold(root.to_string(), |uri, next| uri + &next)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_encoded() {
        assert_eq!(uri("/tmp/a b/ü"), "file:///tmp/a%20b/%C3%BC");
        assert_eq!(uri("C:\\tmp"), "file:///C:/tmp");
    }

    #[test]
    fn each_platform_has_its_folder() {
        assert_eq!(platforms(Version::Two, "linux", "x86_64"), ["linux64", "x86_64-linux"]);
        assert_eq!(platforms(Version::Three, "macos", "aarch64"), ["aarch64-darwin"]);
        assert_eq!(platforms(Version::Two, "linux", "aarch64"), ["aarch64-linux"]);
    }
}
