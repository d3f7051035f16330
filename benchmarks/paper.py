"""Numbers of the BricksRL paper (arXiv:2406.17490), measured on LEGO robots, for comparison."""

from __future__ import annotations

Spread = tuple[float, float]
"""Mean and standard deviation, of 5 seeds with 5 episodes each."""

RETURNS: dict[str, dict[str, Spread]] = {
    "RunAway-v0": {
        "td3": (7.64, 2.31),
        "sac": (8.72, 2.82),
        "droq": (8.96, 0.87),
        "random": (-0.51, 1.84),
    },
    "Spinning-v0": {
        "td3": (7558.21, 28.61),
        "sac": (7407.20, 109.53),
        "droq": (7456.85, 18.02),
        "random": (71.97, 501.79),
    },
    "Walker-v0": {
        "td3": (-62.94, 16.76),
        "sac": (-52.04, 8.79),
        "droq": (-57.63, 10.44),
        "random": (-191.99, 18.19),
    },
    "WalkerSim-v0": {
        "td3": (-78.49, 9.75),
        "sac": (-55.03, 4.95),
        "droq": (-56.62, 2.81),
        "random": (-191.99, 18.19),
    },
    "RoboArm-v0": {
        "td3": (-20.29, 31.35),
        "sac": (-27.77, 37.13),
        "droq": (-55.02, 62.45),
        "random": (-149.26, 88.19),
    },
    "RoboArmSim-v0": {
        "td3": (-12.78, 21.09),
        "sac": (-3.45, 2.66),
        "droq": (-14.04, 26.05),
        "random": (-149.26, 88.19),
    },
    "RoboArm_mixed-v0": {
        "td3": (-60.24, 16.06),
        "sac": (-18.21, 6.98),
        "droq": (-19.39, 11.07),
        "random": (-57.23, 10.01),
    },
}
"""Table 2 of the paper, by training environment; agents trained in simulation were evaluated on the
robot too."""

SUCCESS: dict[str, dict[str, float]] = {
    "RoboArm-v0": {"td3": 0.88, "sac": 0.72, "droq": 0.64, "random": 0.32},
    "RoboArmSim-v0": {"td3": 0.88, "sac": 1.0, "droq": 0.88},
    "RoboArm_mixed-v0": {"td3": 0.08, "sac": 0.68, "droq": 0.68, "random": 0.40},
}
"""Table 3 of the paper: success rates over 25 episodes."""

MINUTES = {
    "RunAway-v0": 15.0,
    "Spinning-v0": 10.0,
    "Walker-v0": 70.0,
    "RoboArm-v0": 60.0,
    "RoboArm_mixed-v0": 40.0,
}
"""Duration of a training of SAC on the robot, as the text of the paper states."""

OFFLINE: dict[tuple[str, str], dict[str, float]] = {
    ("Walker-v0", "random"): {
        "td3": -79.71,
        "sac": -66.91,
        "bc": -202.46,
        "iql": -136.13,
        "cql": -72.75,
    },
    ("Walker-v0", "expert"): {
        "td3": -153.45,
        "sac": -255.41,
        "bc": -85.65,
        "iql": -74.80,
        "cql": -77.93,
    },
    ("RoboArm-v0", "random"): {
        "td3": -124.22,
        "sac": -54.67,
        "bc": -117.72,
        "iql": -76.89,
        "cql": -46.91,
    },
    ("RoboArm-v0", "expert"): {
        "td3": -201.94,
        "sac": -218.76,
        "bc": -7.34,
        "iql": -3.10,
        "cql": -17.41,
    },
    ("RunAway-v0", "random"): {"td3": 19.86, "sac": 14.74, "bc": -0.27, "iql": 14.07, "cql": 19.60},
    ("RunAway-v0", "expert"): {"td3": 9.06, "sac": 10.80, "bc": 18.13, "iql": 18.80, "cql": 19.74},
    ("Spinning-v0", "random"): {
        "td3": 6160.25,
        "sac": 5416.11,
        "bc": 35.55,
        "iql": 4544.28,
        "cql": 4509.31,
    },
    ("Spinning-v0", "expert"): {
        "td3": 6168.28,
        "sac": 9349.52,
        "bc": 9150.02,
        "iql": 9096.60,
        "cql": 9099.03,
    },
}
"""The paper's table of offline agents: mean returns by task, kind of dataset and agent."""

DATASETS: dict[str, dict[str, float]] = {
    "Walker-v0": {"mean_reward": -69.12, "expert_transitions": 9244, "random_transitions": 10000},
    "RoboArm-v0": {"mean_reward": -9.87, "expert_transitions": 1297, "random_transitions": 10000},
    "RunAway-v0": {"mean_reward": 18.04, "expert_transitions": 1987, "random_transitions": 1612},
    "Spinning-v0": {"mean_reward": 8981.19, "expert_transitions": 5000, "random_transitions": 5000},
}
"""The paper's table of datasets of 100 episodes each; the reward is that of the expert data."""
