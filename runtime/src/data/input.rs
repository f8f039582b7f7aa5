//! Where the bytes come from: a trait, so that tests, fuzzing and embedders need no disk.

use compiler::loader::LoadError;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A set of files by name.
pub trait Files {
    /// Opens one file.
    ///
    /// # Errors
    /// `E0601` when there is none, or it cannot be read.
    fn open(&self, path: &Path) -> Result<Input, LoadError>;
}

trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// An open file with its length in bytes.
pub struct Input {
    source: Box<dyn ReadSeek>,
    length: u64,
}

impl Input {
    /// An input over bytes in memory.
    #[must_use]
    pub fn from_bytes(bytes: Vec<u8>) -> Self {
        Self { length: bytes.len() as u64, source: Box::new(Cursor::new(bytes)) }
    }

    /// Its length in bytes.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Up to `n` bytes from the beginning.
    pub(super) fn peek(&mut self, n: u64) -> Result<Vec<u8>, LoadError> {
        let mut bytes = Vec::new();
        self.source.seek(SeekFrom::Start(0)).map_err(|e| unreadable(&e))?;
        (&mut self.source).take(n).read_to_end(&mut bytes).map_err(|e| unreadable(&e))?;
        Ok(bytes)
    }

    /// A buffered view from the beginning that borrows the input.
    pub(super) fn reader(&mut self) -> Result<BufReader<&mut (impl Read + Seek)>, LoadError> {
        self.source.seek(SeekFrom::Start(0)).map_err(|e| unreadable(&e))?;
        Ok(BufReader::new(&mut self.source))
    }

    /// The input as a buffered reader that starts `offset` bytes in.
    pub(super) fn into_reader(mut self, offset: u64) -> Result<BufReader<Self>, LoadError> {
        self.source.seek(SeekFrom::Start(offset)).map_err(|e| unreadable(&e))?;
        Ok(BufReader::new(self))
    }
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.source.read(buffer)
    }
}

impl Seek for Input {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.source.seek(position)
    }
}

/// The files of the machine.
#[derive(Copy, Clone, Debug, Default)]
pub struct Disk;

impl Files for Disk {
    fn open(&self, path: &Path) -> Result<Input, LoadError> {
        let metadata = fs::metadata(path).map_err(|e| missing(path, &e))?;
        // Opening a pipe or a device could wait for ever, and neither has a length to check a header against.
        if !metadata.is_file() {
            let message = if metadata.is_dir() { "is a folder, not a file" } else { "is not a regular file" };
            return Err(LoadError { code: "E0601", message: message.into(), hint: None });
        }
        let file = File::open(path).map_err(|e| missing(path, &e))?;
        Ok(Input { source: Box::new(file), length: metadata.len() })
    }
}

/// Files that exist only in memory.
#[derive(Clone, Debug, Default)]
pub struct Memory(pub BTreeMap<PathBuf, Vec<u8>>);

impl Memory {
    /// A single file.
    pub fn one(path: impl Into<PathBuf>, bytes: impl Into<Vec<u8>>) -> Self {
        Self::default().and(path, bytes)
    }

    /// Adds a file.
    #[must_use]
    pub fn and(mut self, path: impl Into<PathBuf>, bytes: impl Into<Vec<u8>>) -> Self {
        self.0.insert(path.into(), bytes.into());
        self
    }
}

impl Files for Memory {
    fn open(&self, path: &Path) -> Result<Input, LoadError> {
        let bytes = self.0.get(path).ok_or_else(|| missing(path, &io::ErrorKind::NotFound.into()))?;
        Ok(Input::from_bytes(bytes.clone()))
    }
}

/// `E0601` for a file that was found but does not give its bytes.
pub(super) fn unreadable(error: &io::Error) -> LoadError {
    LoadError { code: "E0601", message: format!("cannot be read: {error}"), hint: None }
}

fn missing(path: &Path, error: &io::Error) -> LoadError {
    if error.kind() != io::ErrorKind::NotFound {
        return unreadable(error);
    }
    let hint = match similar(path) {
        Some(name) => format!("did you mean `{name}`?"),
        None => "paths are relative to the file that names them".into(),
    };
    LoadError { code: "E0601", message: "does not exist".into(), hint: Some(hint) }
}

/// A file beside the missing one that differs in case or in its ending alone.
fn similar(path: &Path) -> Option<String> {
    let stem = |name: &str| name.split('.').next().unwrap_or(name).to_lowercase();
    let wanted = stem(&path.file_name()?.to_string_lossy());
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut names: Vec<String> = fs::read_dir(parent)
        .ok()?
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| !wanted.is_empty() && stem(name) == wanted)
        .collect();
    names.sort();
    names.into_iter().next()
}
