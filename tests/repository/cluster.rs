//! The ways to run the shards of a trial on several machines agree on how many there are.

use std::path::Path;

use serde_json::Value;

fn read(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments/trials").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The manifest is JSON, which every YAML parser reads.
#[test]
fn the_kubernetes_job_runs_every_shard_once() {
    let job: Value = serde_json::from_str(&read("indexed-job.json")).unwrap();
    assert_eq!((job["apiVersion"].as_str(), job["kind"].as_str()), (Some("batch/v1"), Some("Job")));
    let spec = &job["spec"];
    assert_eq!(spec["completionMode"], "Indexed");
    let shards = spec["completions"].as_u64().unwrap();
    let pod = &spec["template"]["spec"];
    let container = &pod["containers"][0];
    // Indices begin at 0, shards at 1.
    let shard = format!("--shard $((JOB_COMPLETION_INDEX + 1))/{shards} ");
    assert!(container["args"][0].as_str().unwrap().contains(&shard), "{container}");
    assert_eq!(pod["restartPolicy"], "Never");
    assert_eq!(container["volumeMounts"][0]["name"], pod["volumes"][0]["name"]);
}

#[test]
fn the_slurm_array_runs_every_shard_once() {
    let script = read("array.sbatch");
    assert!(script.contains("#SBATCH --array=1-16\n") && script.contains("SHARDS=\"${SHARDS:-16}\"\n"));
    assert!(script.contains("--shard \"$SLURM_ARRAY_TASK_ID/$SHARDS\""));
}
