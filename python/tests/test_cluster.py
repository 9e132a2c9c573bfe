"""The Kubernetes job that runs the shards of a trial."""

import pathlib

import yaml

JOB = pathlib.Path(__file__).resolve().parents[2] / "experiments" / "trials" / "indexed-job.yaml"


def test_the_kubernetes_job_runs_every_shard_once():
    job = yaml.safe_load(JOB.read_text())
    assert (job["apiVersion"], job["kind"]) == ("batch/v1", "Job")
    spec = job["spec"]
    assert spec["completionMode"] == "Indexed"
    pod = spec["template"]["spec"]
    assert pod["restartPolicy"] == "Never"
    (container,) = pod["containers"]
    assert container["command"] == ["sh", "-c"]
    # Indices begin at 0, shards at 1.
    (line,) = container["args"]
    assert f"diagnose /trial/T --shard $((JOB_COMPLETION_INDEX + 1))/{spec['completions']} " in line
    # Each pod has the cores that its shard uses, and the folder that it names.
    assert line.endswith(f"--jobs {container['resources']['requests']['cpu']}")
    (mount,), (volume,) = container["volumeMounts"], pod["volumes"]
    assert mount == {"name": volume["name"], "mountPath": "/trial"}
    assert volume["persistentVolumeClaim"]["claimName"]
