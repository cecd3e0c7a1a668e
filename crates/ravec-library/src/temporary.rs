//! stand-in
use std::io;
use std::path::{Path, PathBuf};
pub(crate) struct TemporaryFolder {
    path: PathBuf,
    kept: bool,
}
impl TemporaryFolder {
    pub fn beside(target: &Path) -> io::Result<Self> {
        static N: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let n = N.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let h = blake3::hash(
            format!(
                "{:?}{n}{}",
                std::time::SystemTime::now(),
                std::process::id()
            )
            .as_bytes(),
        )
        .to_hex();
        let path = target.with_file_name(format!(
            ".ravec-{}-{}.part",
            target.file_name().unwrap_or_default().to_string_lossy(),
            &h[..8]
        ));
        std::fs::create_dir(&path)?;
        Ok(Self { path, kept: false })
    }
    pub fn path(&self) -> &Path {
        &self.path
    }
    pub fn persist(mut self, target: &Path) -> io::Result<()> {
        std::fs::rename(&self.path, target)?;
        self.kept = true;
        Ok(())
    }
}
impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        if !self.kept {
            let _ = std::fs::remove_dir_all(&self.path);
        }
    }
}
