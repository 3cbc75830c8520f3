"""The paper, in the order of its data flow. Read this table first.

::

    ingest ─> midpoint ─> mixture ─> dynamics ─> rollout ─> evaluate
                  └──────────────────────┴──────────┴──────────┘
                        demonstrations, to learn from and to compare with

=========  ==============================================================  ============================================
stage      what it does                                                    what it writes
=========  ==============================================================  ============================================
ingest     reads recorded demonstrations                                   demonstrations.parquet
midpoint   one point's motion on a uniform clock, eq. (4)                  midpoints.parquet
mixture    Gaussian mixtures over position, eq. (5): one, or candidates    mixture, assignments, sampler .parquet
dynamics   stable dynamical system, eqs. (6)-(8), with a certificate       dynamics.parquet: all that a policy needs
rollout    controllers x conditions x methods of avoidance x starts;       rollouts.parquet, logs
           or two arms that carry boxes, eqs. (9)-(23)
evaluate   swept error area (26), dynamic time warping, recovery,          metrics.parquet
           clearance, contact force
=========  ==============================================================  ============================================

Each stage is a folder: ``stage.py`` signs the contract of `pipeline.stage`, ``parameters.py`` declares what can be set,
and the other modules are the mathematics, arrays in and arrays out. `stages/artifacts` holds the tables between them,
`stages/policy` what a robot runs (in `avoidance` one file a method of keeping clear), `stages/world` what it is run
against, `stages/teleoperation` how it is led by hand, eqs. (1)-(3), `stages/figures` what the report shows.
"""

STAGES = (
    "stages.ingest.stage:STAGE",
    "stages.midpoint.stage:STAGE",
    "stages.mixture.stage:STAGE",
    "stages.dynamics.stage:STAGE",
    "stages.rollout.stage:STAGE",
    "stages.evaluate.stage:STAGE",
)
