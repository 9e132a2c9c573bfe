use std::fs;
use std::path::Path;
use std::process::Command;

use serde::{Deserialize, Serialize};

/// The machine on which a study ran, and the compiler of the program. Unknown values are empty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Model of the CPU.
    pub cpu: String,
    /// Logical cores that this process may use.
    pub logical_cores: usize,
    /// Caches of the first core.
    pub caches: Vec<Cache>,
    /// Instruction sets of the CPU that are relevant to arithmetic.
    pub cpu_features: Vec<String>,
    /// Operating system, and its kernel's version where known.
    pub os: String,
    /// Target triple of the compiler.
    pub target: String,
    /// Instruction sets for which the whole program was compiled; kernels that are selected at run time may use more.
    pub target_features: String,
    /// Flags given to the compiler in addition to Cargo's.
    pub rustflags: String,
    /// Version of the compiler.
    pub rustc: String,
    /// Level of optimisation, 0 to 3.
    pub opt_level: String,
    /// Version of plid.
    pub plid: String,
    /// Load averages over 1, 5 and 15 minutes before the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load_average: Option<[f64; 3]>,
}

/// One cache.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cache {
    /// Its level; 1 is next to the core.
    pub level: usize,
    /// Its kind: Data, Instruction or Unified.
    pub kind: String,
    /// Its size.
    pub bytes: usize,
}

impl Machine {
    /// Describes this machine.
    pub fn here() -> Self {
        Self {
            cpu: cpu(),
            logical_cores: std::thread::available_parallelism().map_or(1, usize::from),
            caches: caches(Path::new("/sys/devices/system/cpu/cpu0/cache")),
            cpu_features: cpu_features(),
            os: os(),
            target: env!("PLID_BUILT_WITH_TARGET").into(),
            target_features: env!("PLID_BUILT_WITH_TARGET_FEATURES").into(),
            rustflags: env!("PLID_BUILT_WITH_RUSTFLAGS").into(),
            rustc: env!("PLID_BUILT_WITH_RUSTC").into(),
            opt_level: env!("PLID_BUILT_WITH_OPT_LEVEL").into(),
            plid: env!("CARGO_PKG_VERSION").into(),
            load_average: load_average(),
        }
    }

    /// Returns the properties on which times depend, as text: the machine without its load.
    pub fn identity(&self) -> String {
        format!("{:?}", Self { load_average: None, ..self.clone() })
    }

    /// Returns the size in bytes of the largest cache of a level that holds data.
    pub fn data_cache(&self, level: usize) -> Option<usize> {
        self.caches.iter().filter(|c| c.level == level && c.kind != "Instruction").map(|c| c.bytes).max()
    }

    /// Returns names and values for the footer of a report.
    pub fn lines(&self) -> Vec<(&'static str, String)> {
        let cache = |c: &Cache| format!("L{} {} {} KiB", c.level, c.kind.to_lowercase(), c.bytes / 1024);
        let load = self.load_average.map_or("unknown".into(), |l| format!("{:.2} {:.2} {:.2}", l[0], l[1], l[2]));
        let flags = if self.rustflags.is_empty() { "none" } else { &self.rustflags };
        vec![
            ("CPU", format!("{}, {} logical cores", self.cpu, self.logical_cores)),
            ("caches", self.caches.iter().map(cache).collect::<Vec<_>>().join(", ")),
            ("CPU features", self.cpu_features.join(" ")),
            ("operating system", self.os.clone()),
            ("load average at the start", load),
            ("compiler", format!("{}, target {}, opt-level {}", self.rustc, self.target, self.opt_level)),
            ("compiled for", self.target_features.replace(',', " ")),
            ("RUSTFLAGS", flags.into()),
            ("plid", self.plid.clone()),
        ]
    }
}

fn read(path: impl AsRef<Path>) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_string())
}

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
}

fn cpu() -> String {
    let model = |text: String| {
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        line.split_once(':').map(|(_, name)| name.trim().to_string())
    };
    read("/proc/cpuinfo")
        .and_then(model)
        .or_else(
            || if cfg!(target_os = "macos") { output("sysctl", &["-n", "machdep.cpu.brand_string"]) } else { None },
        )
        .or_else(|| std::env::var("PROCESSOR_IDENTIFIER").ok())
        .unwrap_or_else(|| std::env::consts::ARCH.into())
}

fn os() -> String {
    match read("/proc/sys/kernel/osrelease") {
        Some(release) => format!("{} {release}", std::env::consts::OS),
        None => std::env::consts::OS.into(),
    }
}

fn load_average() -> Option<[f64; 3]> {
    let text = read("/proc/loadavg")?;
    let mut words = text.split_whitespace().map_while(|word| word.parse().ok());
    Some([words.next()?, words.next()?, words.next()?])
}

/// Returns the caches that Linux lists in a directory such as /sys/devices/system/cpu/cpu0/cache.
fn caches(directory: &Path) -> Vec<Cache> {
    let one = |index: usize| {
        let field = |name: &str| read(directory.join(format!("index{index}")).join(name));
        let size = field("size")?;
        let bytes = match (size.strip_suffix('K'), size.strip_suffix('M')) {
            (Some(number), _) => number.parse::<usize>().ok()? * 1024,
            (_, Some(number)) => number.parse::<usize>().ok()? * 1024 * 1024,
            _ => size.parse().ok()?,
        };
        Some(Cache { level: field("level")?.parse().ok()?, kind: field("type")?, bytes })
    };
    (0..).map_while(one).collect()
}

#[cfg(target_arch = "x86_64")]
fn cpu_features() -> Vec<String> {
    let all = [
        ("sse2", is_x86_feature_detected!("sse2")),
        ("avx", is_x86_feature_detected!("avx")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
        ("avx512vl", is_x86_feature_detected!("avx512vl")),
        ("avx512dq", is_x86_feature_detected!("avx512dq")),
        ("avx512bw", is_x86_feature_detected!("avx512bw")),
    ];
    all.into_iter().filter(|(_, has)| *has).map(|(name, _)| name.to_string()).collect()
}

#[cfg(target_arch = "aarch64")]
fn cpu_features() -> Vec<String> {
    let all = [
        ("neon", std::arch::is_aarch64_feature_detected!("neon")),
        ("sve", std::arch::is_aarch64_feature_detected!("sve")),
    ];
    all.into_iter().filter(|(_, has)| *has).map(|(name, _)| name.to_string()).collect()
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn cpu_features() -> Vec<String> {
    Vec::new()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_has_a_compiler_and_a_core_and_survives_a_round_trip() {
        let machine = Machine::here();
        assert!(machine.logical_cores > 0 && !machine.cpu.is_empty());
        assert!(machine.rustc.starts_with("rustc ") && machine.target.contains('-'));
        let again: Machine = serde_json::from_str(&serde_json::to_string(&machine).unwrap()).unwrap();
        assert_eq!(machine, again);
        let busy = Machine { load_average: Some([9.0; 3]), ..machine.clone() };
        assert_eq!(machine.identity(), busy.identity());
        assert_ne!(machine.identity(), Machine { cpu: "another".into(), ..machine.clone() }.identity());
    }

    #[test]
    fn caches_are_read_as_linux_lists_them() {
        let directory = tempfile::tempdir().unwrap();
        for (index, level, kind, size) in
            [(0, 1, "Data", "32K"), (1, 1, "Instruction", "64K"), (2, 3, "Unified", "32M")]
        {
            let at = directory.path().join(format!("index{index}"));
            fs::create_dir(&at).unwrap();
            fs::write(at.join("level"), format!("{level}\n")).unwrap();
            fs::write(at.join("type"), format!("{kind}\n")).unwrap();
            fs::write(at.join("size"), format!("{size}\n")).unwrap();
        }
        let machine = Machine { caches: caches(directory.path()), ..Machine::here() };
        assert_eq!(machine.data_cache(1), Some(32 * 1024));
        assert_eq!(machine.data_cache(3), Some(32 * 1024 * 1024));
        assert_eq!(machine.data_cache(2), None);
    }
}
