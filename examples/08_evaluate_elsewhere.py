"""Transfer: train in a simulation without a hub, evaluate on the virtual Walker, which runs the
hub's program."""

from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, train


def main(episodes: int = 75) -> None:
    run = train(TrainConfig("WalkerSim-v0", episodes=episodes, seed=0))
    for env_id in ("WalkerSim-v0", "Walker-v0"):
        result = evaluate(run.run_dir, env_id, episodes=2, save=False)
        metrics = ", ".join(f"{name} {value:.2f}" for name, value in result.metrics.items())
        print(f"{env_id}: return {result.return_mean:.1f}, {metrics}")


if __name__ == "__main__":
    main()
