//! The Slurm array runs the shards of a trial. `python/tests/test_cluster.py` checks the job of Kubernetes, which is
//! YAML.

use std::path::Path;

fn read(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments/trials").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn the_slurm_array_runs_every_shard_once() {
    let script = read("array.sbatch");
    assert!(script.contains("#SBATCH --array=1-16\n") && script.contains("SHARDS=\"${SHARDS:-16}\"\n"));
    assert!(script.contains("--shard \"$SLURM_ARRAY_TASK_ID/$SHARDS\""));
}
