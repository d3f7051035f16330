"""Train an agent on a virtual robot, then evaluate it."""

from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, train


def main(episodes: int = 15) -> None:
    run = train(TrainConfig("Spinning-v0", agent="sac", episodes=episodes, seed=0))
    print("returns:", [round(episode.return_) for episode in run.episodes])

    result = evaluate(run.run_dir, episodes=5)
    print(f"after training: {result.return_mean:.0f}, successes: {100 * result.success_rate:.0f} %")

    # Does it still work with a different battery, floor and link in each episode?
    hard = evaluate(run.run_dir, episodes=5, randomize=True, save=False)
    print(f"on other robots: {hard.return_mean:.0f}; all files: {run.run_dir}")


if __name__ == "__main__":
    main()
