/* tiller: model predictive control with an online posterior, in one block of memory that you own.
 * SPDX-License-Identifier: BSD-3-Clause
 *
 * The manual is this header. The life of a controller:
 *
 *     tiller_config_t config;                      // from a robot file: `tiller export robot.toml`
 *     size_t size = tiller_size(&config);          // bytes, exact
 *     tiller_t* t;
 *     tiller_init(&t, &config, memory, size);      // memory aligned to TILLER_ALIGNMENT; no heap, ever
 *     tiller_arm(t);                               // STANDBY -> ACTIVE
 *     for (;;) {
 *       tiller_measurement_t m = ...;              // your encoders
 *       tiller_command_t c;
 *       tiller_tick(t, now_us, &m, &c);            // sense, validate, learn, plan, gate, record
 *       ...                                        // send c.value: it is finite and within the limits
 *     }
 *
 * Rules that hold everywhere:
 *   - `tiller_tick` always fills the command. Whatever went wrong, the command is safe to send; the
 *     returned status says why it is what it is.
 *   - Nothing allocates, blocks, locks, prints or throws after tiller_init. An instance is used by one
 *     thread at a time; instances are independent.
 *   - Units are SI; names carry them. Stamps are microseconds of any one monotonic clock.
 *   - Arrays are sized by the TILLER_MAX constants and filled from the front; rare ones stand behind pointers, whose
 *     comments tell the count. Null: none.
 *   - Structs begin with size and version. Fill them with the *_default() functions, then change fields.
 */
#ifndef TILLER_TILLER_H_
#define TILLER_TILLER_H_

#include <stddef.h>
#include <stdint.h>

#include "tiller/model.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TILLER_VERSION_MAJOR 0
#define TILLER_VERSION_MINOR 2
#define TILLER_CONFIG_VERSION 17u
#define TILLER_ALIGNMENT 64u /**< of the caller's block: one AVX-512 register, one cache line */
#define TILLER_MAX_MEASUREMENTS TILLER_MAX_STATES

/* ---- status ------------------------------------------------------------------------------------- */

/** Codes are in bands: 1..99 usage, 100..199 fault, 200..299 limited; 0 is ok. */
typedef enum tiller_status {
#define TILLER_STATUS(code, name, band, text) tiller_status_##name = code,
#include "tiller/status.def"
#undef TILLER_STATUS
  tiller_status_force_int = 0x7fffffff
} tiller_status_t;

/** One sentence for a status; never NULL. */
const char* tiller_status_text(tiller_status_t status);
/** The status's name, e.g. "sensor_stale"; "unknown" for a code that does not exist. */
const char* tiller_status_name(tiller_status_t status);

/* ---- ranges of numbers --------------------------------------------------------------------------
 *
 * Planners compute in single precision, whose numbers end at 3e38 and, but for denormal ones, at 1e-38; posteriors and
 * gradients in double precision, and square more. Within the ranges below nothing loses its image in single precision,
 * and no square or sum of squares overflows or vanishes in either: the largest weight times the square of the largest
 * difference, 1e12 (2e9)^2, over the longest horizon and all terms of the cost, 512 x 50, is 1e35; the largest
 * difference over the smallest width, squared, 4e36; a difference over a standard deviation, squared, likewise.
 * tiller_config_check refuses what is outside and names the field. */
#define TILLER_LARGEST_VALUE 1e9        /**< of states, inputs, targets, bounds, gains and whatever sensors measure */
#define TILLER_SMALLEST_SCALE 1e-9      /**< of standard deviations, widths, radii and rates, which are not negative: */
#define TILLER_LARGEST_SCALE 1e9        /**< where 0 is allowed too, the field says so */
#define TILLER_SMALLEST_WEIGHT 1e-12    /**< of a cost: a weight is 0, or between this */
#define TILLER_LARGEST_WEIGHT 1e12      /**< and this */
#define TILLER_SMALLEST_PARAMETER 1e-12 /**< of a parameter's magnitude: it is 0, or between this */
#define TILLER_LARGEST_PARAMETER 1e12   /**< and this: products of three stay in single precision */
#define TILLER_SMALLEST_SHARE 1e-6      /**< of fractions that must not be 0 */
#define TILLER_LARGEST_SHARE 0.999      /**< of fractions that must not be 1 */

/* ---- configuration ------------------------------------------------------------------------------ */

typedef enum tiller_prior_kind {
  tiller_prior_fixed = 0,     /**< a = value, a parameter */
  tiller_prior_uniform = 1,   /**< on [low, high], both parameters */
  tiller_prior_normal = 2,    /**< mean a, standard deviation b, cut to [low, high] */
  tiller_prior_log_normal = 3 /**< median a, standard deviation b of the logarithm, cut to [low, high] */
} tiller_prior_kind_t;

/** The prior of a parameter, before the first measurement. Every value out to eight deviations must be a
 *  parameter's (at most TILLER_LARGEST_PARAMETER; of a log-normal prior at least TILLER_SMALLEST_PARAMETER), if need be
 *  by the bounds. */
typedef struct tiller_prior {
  uint32_t kind; /**< tiller_prior_kind_t */
  uint32_t reserved;
  double a, b;      /**< see the kind; b of a normal prior is a parameter above 0, of a log-normal one a scale */
  double low, high; /**< hard bounds, parameters; -INFINITY, INFINITY for none */
} tiller_prior_t;

/** The effects' kinds: one for each line of effects.def, in its order. */
typedef enum tiller_effect_kind {
#define TILLER_EFFECT(name, Type, ...) tiller_effect_##name,
#include "tiller/effects.def"
#undef TILLER_EFFECT
  tiller_effect_kind_count
} tiller_effect_kind_t;

#define TILLER_EVERY_PORT 0xFFFFFFFFu /**< of an effect: all ports that it fits, with the same parameters */

/** An effect at a port of the model. Its parameters follow the model's in `priors`, in the order in
 *  which the effects stand here. */
typedef struct tiller_effect {
  uint32_t kind; /**< tiller_effect_kind_t */
  uint32_t port; /**< index, by the effect: of the joint, the input, or the state that a sensor measures; 0: body; or
                  *   TILLER_EVERY_PORT, which counts as many effects and states as there are ports */
} tiller_effect_t;

typedef enum tiller_integrator {
  tiller_integrator_semi_implicit_euler = 0,
  tiller_integrator_midpoint = 1,
  tiller_integrator_rk4 = 2
} tiller_integrator_t;

/** One value, tiller_planner_<name>, for each line of tiller/planners.def. */
typedef enum tiller_planner_kind {
#define TILLER_PLANNER(name, help) tiller_planner_##name,
#include "tiller/planners.def"
  tiller_planner_kind_count
} tiller_planner_kind_t;

typedef enum tiller_risk {
  tiller_risk_mean = 0, /**< expected cost over the particles */
  tiller_risk_cvar = 1, /**< mean of the worst (1 - alpha) share of whole trajectories */
  tiller_risk_worst = 2 /**< the costliest particle */
} tiller_risk_t;

/** Which hypotheses a planner plans over. */
typedef enum tiller_hypotheses {
  tiller_hypotheses_drawn = 0,       /**< from the posterior, equally likely */
  tiller_hypotheses_sigma_points = 1 /**< its mean, and points to both sides of it along the widest axes of its
                                          covariance, weighed so that mean and covariance along them are exact */
} tiller_hypotheses_t;

/** Interpolation between the knots of a sampled sequence. */
typedef enum tiller_interpolation {
  tiller_interpolation_linear = 0,
  tiller_interpolation_cubic = 1 /**< monotone cubic (Fritsch and Carlson 1980): smooth, never beyond its knots */
} tiller_interpolation_t;

/** How a gradient planner's trajectory hangs together between its iterations. */
typedef enum tiller_shooting {
  tiller_shooting_single = 0,  /**< states follow from the inputs: every iterate is a motion of the model */
  tiller_shooting_multiple = 1 /**< states are variables too; their defects are closed by the iterations */
} tiller_shooting_t;

/** Who solves the quadratic programs of `sqp`. */
typedef enum tiller_qp_solver {
  tiller_qp_riccati = 0, /**< interior point over a Riccati sweep: exploits the horizon's structure */
  tiller_qp_osqp = 1     /**< OSQP (operator splitting, sparse): general */
} tiller_qp_solver_t;

/** How what was measured is taken in, see docs/theory/posterior.md: tiller_posterior_<name> for each line of
 *  tiller/posteriors.def. */
typedef enum tiller_posterior_kind {
#define TILLER_POSTERIOR(name, help) tiller_posterior_##name,
#include "tiller/posteriors.def"
  tiller_posterior_kind_count
} tiller_posterior_kind_t;

#define TILLER_MAX_HYPOTHESES 4 /**< input delays of 0 to 3 periods */
#define TILLER_MAX_FORGETTING 3
#define TILLER_MAX_DRIFTS 4

/** How the posterior is kept. */
typedef struct tiller_posterior_config {
  uint32_t enabled;          /**< 0: frozen at the prior (the state is still estimated) */
  uint32_t particles;        /**< N, a multiple of 16, 16..4096 */
  uint32_t window;           /**< transitions kept for moves, 16..1024 */
  uint32_t moves_per_tick;   /**< Metropolis moves per tick, a multiple of 8, 0..N */
  double ess_fraction;       /**< resample when the effective sample size falls below this share of N, 1e-6..1 */
  double noise_scale_shape;  /**< a0 of the inverse gamma over the noise variance's scale (`transition`: one scale per
                                    state; else one for all); the larger, the more the configured noise is believed;
                                    1e-6..1e6 */
  uint32_t kind;             /**< tiller_posterior_kind_t */
  uint32_t robust;           /**< transition: 1: one weight per transition, low where no particle explains it */
  uint32_t disturbance;      /**< filter: 1: at each joint a force that the model lacks, which wanders (of a model
                                    without joints a slip of each state with process_sd), beside the parameters; of up
                                    to four joints a viscous and a dry one too; plans count them. transition: at the
                                    first four joints, constant, viscous and dry; residuals may be correlated */
  uint32_t delay_hypotheses; /**< transition: input delays from 0 to n-1 periods, parts of a period included, weighed by
                                  their evidence; 1..TILLER_MAX_HYPOTHESES, 1: no delay */
  uint32_t forgetting_count; /**< transition: rates side by side, 1..TILLER_MAX_FORGETTING */
  uint32_t adequacy;         /**< 1: the innovations are tested at every tick (tiller_info_t.adequacy) */
  double forgetting[TILLER_MAX_FORGETTING]; /**< share of the old data that each tick keeps, in [0.5, 1], largest
                                    first; 1: nothing is forgotten. Of several the rate is chosen by predictive
                                    likelihood; filter, conjugate: one */
  double prior_proposal_fraction; /**< of the moves that are tried from the prior's whole width, in [0, 0.5] */
  double noise_ratio_sd; /**< filter: standard deviation of the logarithm of process_sd's true factor beside that of
                              measurement_sd, which is inferred; 0: process_sd and measurement_sd share one factor;
                              in [0, 10] */
  uint32_t relearn;      /**< filter: 1: an alarm of the adequacy test in motion makes what was learnt one half of a new
                              prior, beside the configured one, so that a robot that has changed is learnt again */
  uint32_t reserved;     /**< 0 */
  uint64_t drift;        /**< filter: bit i: parameter i drifts, a random walk of its coordinate whose rate is inferred;
                              TILLER_MAX_DRIFTS at most, none that is fixed or a sensor's */
} tiller_posterior_config_t;

/** A joint prior of the inferred parameters, in their order in `priors` and in their coordinates (the logarithm where
 *  the marginal prior is log-normal): a mixture of normals, cut to the marginals' bounds; the marginals' densities do
 *  not count then. The arrays are the caller's and outlive the controller. */
typedef struct tiller_mixture {
  uint32_t size;        /**< sizeof(tiller_mixture_t) */
  uint32_t version;     /**< TILLER_CONFIG_VERSION */
  uint32_t components;  /**< 1..64 */
  uint32_t dimension;   /**< d: number of priors that are not fixed */
  const double* weight; /**< (components) >= 0, sum one */
  const double* mean;   /**< (components x d) row-major; out to eight deviations as a marginal prior's values */
  const double* root;   /**< (components x d x d) lower Cholesky factors of the covariances, row-major; their diagonals
                             are parameters above 0 */
} tiller_mixture_t;

/** How commands are planned. Sampling planners draw `rollouts` sequences of `knots` values per input; gradient
 *  planners (ilqr, sqp) linearise around one sequence, on up to TILLER_MAX_SCENARIOS particles. Each setting names
 *  the planners that read it; docs/theory/planners.md tells when to use which. */
typedef struct tiller_planner_config {
  uint32_t kind;                      /**< tiller_planner_kind_t */
  uint32_t horizon;                   /**< steps of period_s, 2..512 */
  uint32_t knots;                     /**< control points per input over the horizon, linear in between, 2..64 */
  uint32_t rollouts;                  /**< K, a multiple of 16, 16..8192 */
  uint32_t particles;                 /**< M particles of the posterior per rollout, 1..64 */
  uint32_t iterations;                /**< cap per tick, 1..100 */
  uint32_t deadline_us;               /**< per tick, from its start, by hooks.now_ns; 0: iterations alone decide */
  uint32_t risk;                      /**< tiller_risk_t */
  double cvar_alpha;                  /**< in [0, .999]: 0 is the mean, .9 the mean of the worst tenth */
  double noise_sd[TILLER_MAX_INPUTS]; /**< of the samples, in the input's unit; scales; 0: twice the input's range */
  double temperature;                 /**< MPPI: target effective share of the rollouts, 1e-6..1 */
  double elite_fraction;              /**< CEM, 1e-6..1 */
  double smoothing;                   /**< CEM: share of the old mean and spread that is kept, in [0, .999] */

  /* sampling planners */
  uint32_t interpolation;    /**< tiller_interpolation_t */
  uint32_t adapt_covariance; /**< MPPI, CEM: 1: the spread of each knot follows the weighted samples */
  double noise_colour;       /**< power of the samples' spectrum over the knots goes as f^-colour; 0 white, 2 a
                                    random walk; in [0, 4] */
  double filter;             /**< MPPI, PDDM's beta, 1e-6..1: n_t = beta noise_t + (1 - beta) n_(t-1); 1: off */
  double anneal_iterations;  /**< e-folds by which the spread falls from a tick's first iteration to its last, 0..20 */
  double anneal_horizon;     /**< e-folds by which the first knot's spread is below the last one's, [0, 20] */

  /* plans that will learn */
  uint32_t closed_loop;  /**< 1: each particle corrects its way by feedback on its own state (sampling planners), or has
                              a sequence of its own (ilqr, sqp), after the steps that all share */
  uint32_t shared_steps; /**< with closed_loop: steps whose inputs are the same for all particles, 1..512 */
  uint32_t
      predict_spread; /**< 1: every plan comes with mean and deviation of the states ahead: tiller_get_prediction */
  uint32_t noisy_rollouts; /**< 1: each particle's rollouts carry a start error and process noise, drawn once a tick for
                                all samples (sampling planners) */
  uint32_t hypotheses;     /**< tiller_hypotheses_t */
  uint32_t fallback; /**< policy: tiller_planner_kind_t of who plans where the policy is not to be trusted; policy: it
                            commands always */

  /* gradient planners */
  uint32_t shooting;          /**< iLQR, SQP, hybrid: tiller_shooting_t */
  uint32_t qp_solver;         /**< SQP: tiller_qp_solver_t */
  uint32_t qp_iterations;     /**< SQP: cap of the solver per quadratic program, 1..10000 */
  uint32_t refine_iterations; /**< hybrid: gradient iterations on the best sample, 0..20 */
  double qp_tolerance;        /**< SQP: largest KKT residual that counts as solved, 1e-12..1 */
  double regularisation;      /**< iLQR, SQP, hybrid: least addition to the inputs' curvature, in [0, 1e6] */

  /* tree search */
  uint32_t levels;        /**< MCTS: values per input between its limits, 2..16 */
  uint32_t nodes;         /**< MCTS: size of the pool, 16..65536 */
  uint32_t hold_steps;    /**< MCTS: periods for which a choice holds, 1..horizon */
  uint32_t predict_delay; /**< 1: each particle is brought forward over its own input delay and the plan
                                    starts there; gradient planners always do */
  double exploration;     /**< MCTS: weight of the confidence bound, in shares of the costs' range, in [0, 1e6] */
} tiller_planner_config_t;

/** Probing: plans that spend on finding out what the task will need to know (dual control). Beside every plan the
 *  prober looks for one that costs little more and tells the hypotheses apart before they want different inputs. It
 *  is sent in the plan's place while what it is expected to save is more than what it costs. See
 *  docs/theory/probing.md. */
typedef struct tiller_probe_config {
  double weight;       /**< of the expected saving against the cost; 1: as the horizon shows it; 0: no prober;
                            TILLER_SMALLEST_WEIGHT: a prober for calibrations alone; weights */
  double budget;       /**< share of the task's cost that probing may add, in [0, 10] */
  double risk;         /**< probability at which a probing plan may leave the bounds of states, in (0, 0.5] */
  uint32_t hypotheses; /**< drawn from the posterior to judge by, 2..32; 0: those of the planner, 8 where it has
                            fewer than 4 */
  uint32_t rollouts;   /**< motions tried on each of them in a tick, a multiple of 64, 64..1024 */
  const double* until_sd; /**< (param_count) probing ends once each parameter's deviation is below this; INFINITY: it has
                               no say; scales; null: it ends where nothing is to be gained. Copied by tiller_init */
} tiller_probe_config_t;

#define TILLER_MAX_COST_TERMS 8
#define TILLER_MAX_COST_TERM_STATES 4
#define TILLER_MAX_COST_TERM_PARAMS 6

/** The kinds of terms of the cost that are made of a residual of a few states: one for each line of costs.def, in its
 *  order. */
typedef enum tiller_cost_term_kind {
#define TILLER_COST_TERM(key, Type) tiller_cost_term_##key,
#include "tiller/costs.def"
#undef TILLER_COST_TERM
  tiller_cost_term_kind_count
} tiller_cost_term_kind_t;

/** A term of the catalogue: a period, and the horizon's last state, cost weight r(states, params)^2. What the states
 *  and parameters of a kind are, and which ranges they have: docs/reference/costs.md. */
typedef struct tiller_cost_term {
  uint32_t kind;                                /**< tiller_cost_term_kind_t */
  uint32_t states[TILLER_MAX_COST_TERM_STATES]; /**< indices of different states, as many as the kind has */
  uint32_t reserved;
  double weight; /**< a weight; 0: off */
  double params[TILLER_MAX_COST_TERM_PARAMS];
} tiller_cost_term_t;

/** The cost of the last state of the horizon. */
typedef enum tiller_terminal {
  tiller_terminal_diagonal = 0, /**< (x-t)' Qf (x-t) */
  tiller_terminal_lqr = 1       /**< that, and the LQR cost-to-go at `target` for the priors' centre: the horizon then
                                    goes on for ever as far as the model is linear there */
} tiller_terminal_t;

/** What is measured between a demonstrated distribution and the predicted one. */
typedef enum tiller_divergence {
  tiller_divergence_cross_entropy = 0, /**< -E log demonstration, under the prediction */
  tiller_divergence_kl = 1             /**< KL(demonstration || prediction), entropies included */
} tiller_divergence_t;

/** Where the inputs' weights count from. */
typedef enum tiller_input_reference {
  tiller_input_reference_zero = 0,  /**< no input */
  tiller_input_reference_steady = 1 /**< the constant input that holds the target best, by the posterior's mean of
                                         parameters and forces: it costs nothing, so that neither gravity nor a constant
                                         force leaves an offset. While rows of a reference are followed: no input */
} tiller_input_reference_t;

/** A cost of your own in C: the slow path, one lane at a time, with central differences for gradients. The fast one
 *  is a template beside the model (docs/reference/costs.md). Pure functions; what is not finite fails the trajectory.
 *  */
typedef struct tiller_own_cost {
  uint32_t size;    /**< sizeof(tiller_own_cost_t) */
  uint32_t version; /**< TILLER_CONFIG_VERSION */
  /** Cost of one step in state x (nx) under input u (nu) with the model's parameters p (np); time_s since the task
   *  began. Required. */
  double (*stage)(const double* x, const double* u, const double* p, double time_s, void* context);
  /** Cost of the horizon's last state; null: none. */
  double (*terminal)(const double* x, const double* p, double time_s, void* context);
  void* context;
} tiller_own_cost_t;

/** The cost of one output of the model (tiller_model_t.outputs). Outputs do not wrap: an angle is better told by its
 *  sine and cosine. */
typedef struct tiller_output_cost {
  double target;          /**< t, a value */
  double weight;          /**< w, a weight */
  double terminal_weight; /**< in the place of w at the end of the horizon, a weight */
  double low, high;       /**< bounds, values; -INFINITY, INFINITY for none */
  double bound_weight;    /**< b, a weight */
} tiller_output_cost_t;

/** The task. Every term is off while its weight is zero. Per step
 *
 *    (x-t)' Q (x-t) + u' R u + du' S du                      du: change per period; differences of angles wrapped
 *  + w_s (1 - exp(-1/2 sum_i ((x_i-t_i) / width_i)^2))       saturating (Deisenroth and Rasmussen, PILCO, 2011)
 *  + sum_i b_i max(0, low_i - x_i, x_i - high_i)^2           soft bounds
 *  + sum_j w_j (y_j-t_j)^2 + b_j max(0, low_j - y_j, y_j - high_j)^2    outputs y of the model
 *  + terms of the catalogue costs.def + demonstration + own
 *
 *  and at the end of the horizon Qf in the place of Q, without the inputs. Where a reference is given, its row takes
 *  the place of t. */
typedef struct tiller_cost_config {
  double target[TILLER_MAX_STATES];            /**< t, values */
  double state_weight[TILLER_MAX_STATES];      /**< Q, weights */
  double terminal_weight[TILLER_MAX_STATES];   /**< Qf, weights */
  double input_weight[TILLER_MAX_INPUTS];      /**< R, weights */
  double input_rate_weight[TILLER_MAX_INPUTS]; /**< S, weights */

  uint32_t terminal;                          /**< tiller_terminal_t */
  uint32_t term_count;                        /**< 0..TILLER_MAX_COST_TERMS */
  double saturating_weight;                   /**< w_s, a weight */
  double saturating_width[TILLER_MAX_STATES]; /**< scales; INFINITY: the state has no say */

  const double* state_low;    /**< (nx) bounds of the unwrapped state, values; -INFINITY for none; null: none at all */
  const double* state_high;   /**< (nx) likewise, INFINITY for none */
  const double* bound_weight; /**< (nx) b, weights; null: zero */
  uint32_t hard_bounds;       /**< bit i: `sqp` keeps the bounds of state i as constraints (softened by an exact
                                   penalty only where they cannot be kept); other planners know b alone */
  uint32_t demonstration_divergence; /**< tiller_divergence_t */
  double
      bound_risk; /**< `sqp`: hard bounds are kept so far away that the predicted spread carries the state beyond them
                          with this probability, over the horizon; in (0, 0.5], 0: off */
  const tiller_cost_term_t* terms; /**< (term_count) of the catalogue */

  /* A trajectory to track: row k is the target k periods after the task began; the last row holds. The arrays are
   * the caller's and outlive the controller, as the model's table does. */
  const double* reference; /**< (reference_steps x nx), row-major, values; null: `target` */
  /* A demonstrated distribution: a Gaussian per period. Cost per step w_d / 2 |W_k (x - mean_k)|^2, W_k' W_k the
   * inverse covariance: its cross-entropy. demonstration_divergence may ask for KL (Englert et al. 2013) instead. */
  const double* demonstration_mean; /**< (demonstration_steps x nx), values */
  const double* demonstration_root; /**< W: (demonstration_steps x nx x nx), row-major; w_d W^2 at most as any weight */
  uint32_t reference_steps;
  uint32_t demonstration_steps;
  double demonstration_weight; /**< w_d, a weight */

  const tiller_own_cost_t* own; /**< null: the cost template that the model's kernels were compiled with, if any */
  double own_weight;            /**< a weight */

  const tiller_output_cost_t* outputs; /**< (output_count), copied by tiller_init; null: no output has a say */
  const double* output_reference;      /**< (output_reference_steps x ny), values: rows as `reference` has them; null:
                                            the targets. The caller's */
  uint32_t output_reference_steps;
  uint32_t output_count;    /**< the model's count of outputs, or 0 */
  uint32_t input_reference; /**< tiller_input_reference_t */
  uint32_t reserved;        /**< 0 */
} tiller_cost_config_t;

/** A second-order cone of inputs: sqrt(sum over `inputs` of u_i^2) <= limit + slope * u_axis. With slope 0 the limit of
 *  a norm (a thruster's largest force, a pair's current), else a friction or gimbal cone. */
typedef struct tiller_input_cone {
  uint32_t inputs; /**< bit i: input i stands in the norm; 0 lies within its limits */
  uint32_t axis;   /**< input along the cone's axis; read with a slope, and in no cone's norm */
  double slope;    /**< a weight; limit + slope * input_low[axis] is not negative */
  double limit;    /**< a scale, or 0 with a slope */
} tiller_input_cone_t;
#define TILLER_MAX_INPUT_CONES 4

/** The answer to a force that the model does not contain. */
typedef enum tiller_contact {
  tiller_contact_hold = 0, /**< HOLD while it lasts */
  tiller_contact_safe = 1  /**< SAFE, latched */
} tiller_contact_t;

/** Limits and the answers to faults. */
typedef struct tiller_safety_config {
  double input_low[TILLER_MAX_INPUTS]; /**< command limits, values */
  double input_high[TILLER_MAX_INPUTS];
  double input_rate_per_s[TILLER_MAX_INPUTS]; /**< largest change of the command, scales; INFINITY: none */
  double safe_command[TILLER_MAX_INPUTS];     /**< sent in SAFE and before ACTIVE; usually zero */
  const double* hold_gain;        /**< K (nu x nx), row-major, values. HOLD: u = safe - K (x - target); null: zero */
  const double* measurement_low;  /**< (ny) outside: sensor_out_of_range; values, or +-INFINITY for none; null: none.
                                      Beyond TILLER_LARGEST_VALUE a reading is out of range always */
  const double* measurement_high; /**< (ny) likewise */
  const double* measurement_rate_per_s;    /**< (ny) faster: sensor_jump; scales, INFINITY for none; null: none */
  double sensor_timeout_s;                 /**< older than this: SAFE */
  uint32_t frozen_ticks;                   /**< identical readings in a row under a moving plan: SAFE; 0: off */
  uint32_t bad_ticks_to_safe;              /**< consecutive rejected measurements: SAFE */
  uint32_t hold_ticks_to_safe;             /**< consecutive ticks in HOLD: SAFE; 0: HOLD may last */
  uint32_t cone_count;                     /**< 0..TILLER_MAX_INPUT_CONES */
  const tiller_input_cone_t* cones;        /**< (cone_count) kept by every planner and by the last gate */
  double contact_force[TILLER_MAX_STATES]; /**< of the joint whose velocity this state is, N or N m, scales: a larger
                                                force beyond the model is a contact; INFINITY: none. Wants
                                                posterior.disturbance */
  uint32_t contact_action;                 /**< tiller_contact_t */
  uint32_t contact_reserved;               /**< 0 */
} tiller_safety_config_t;

/** What a network's features are. */
typedef enum tiller_network_kind {
  tiller_network_tanh = 0,    /**< a perceptron: up to two layers of tanh, then a linear one */
  tiller_network_gaussian = 1 /**< squared exponentials about centres, and cosines; then a linear layer */
} tiller_network_kind_t;

#define TILLER_MAX_NETWORK_MEMBERS 16
#define TILLER_MAX_NETWORK_WIDTH 64     /**< of a layer of tanh */
#define TILLER_MAX_NETWORK_FEATURES 512 /**< centres and waves together */
#define TILLER_MAX_NETWORK_INPUTS (4 * TILLER_MAX_STATES + 2 * TILLER_MAX_PARAMS + TILLER_MAX_INPUTS)
#define TILLER_MAX_NETWORK_OUTPUTS (TILLER_MAX_JOINTS > TILLER_MAX_INPUTS ? TILLER_MAX_JOINTS : TILLER_MAX_INPUTS)

/** Functions that were learnt: `members` of one shape, as an ensemble has them. Layout of the weights, each of which is
 *  at most TILLER_LARGEST_VALUE in size:
 *
 *    tanh      for each member, for each layer, for each of its outputs: bias, a weight for each of its inputs
 *    gaussian  (inputs) inverse widths s; (hidden[0] x inputs) centres c; (hidden[1] x (1 + inputs)) phase and wave
 *              vector of each wave; then for each member, for each output: bias, a weight for each centre and wave.
 *              Features: exp(-1/2 sum_i (s_i (x_i - c_i))^2) and cos(phase + sum_i k_i x_i) */
typedef struct tiller_network {
  uint32_t size;    /**< sizeof(tiller_network_t) */
  uint32_t version; /**< TILLER_CONFIG_VERSION */
  uint32_t kind;    /**< tiller_network_kind_t */
  uint32_t inputs, outputs;
  uint32_t members;      /**< 1..TILLER_MAX_NETWORK_MEMBERS */
  uint32_t hidden[2];    /**< tanh: widths of the layers, 0: none; gaussian: numbers of centres and of waves */
  const float* weights;  /**< (weight_count), the caller's, constant */
  uint32_t weight_count; /**< as the layout has it: a check on the array */
  uint32_t reserved;     /**< 0 */
} tiller_network_t;

/** What a policy reads, in this order. */
typedef enum tiller_policy_input {
  tiller_policy_state = 1,         /**< every state; of an angle its sine and its cosine */
  tiller_policy_goal = 2,          /**< state less target, angles wrapped */
  tiller_policy_belief_mean = 4,   /**< mean over the hypotheses of every parameter that is not fixed */
  tiller_policy_belief_spread = 8, /**< and its standard deviation */
  tiller_policy_last_command = 16
} tiller_policy_input_t;

/** How a policy's output o becomes an input between its limits: middle + half the range times */
typedef enum tiller_policy_squash {
  tiller_policy_cut = 0, /**< o cut to [-1, 1] */
  tiller_policy_sine = 1 /**< (9 sin o + sin 3 o) / 8: PILCO's */
} tiller_policy_squash_t;

/** A learnt policy: the planner `policy` evaluates it in the place of planning. */
typedef struct tiller_policy {
  uint32_t size;                   /**< sizeof(tiller_policy_t) */
  uint32_t version;                /**< TILLER_CONFIG_VERSION */
  uint32_t reads;                  /**< tiller_policy_input_t, added up */
  uint32_t squash;                 /**< tiller_policy_squash_t */
  const tiller_network_t* network; /**< one member; an output for each input of the model */
  const float* input_low;  /**< (network->inputs) range that the policy was trained on; beyond it by more than a tenth
                                of its width the fallback plans; null: not watched */
  const float* input_high; /**< likewise; both or none */
} tiller_policy_t;

/** Everything a controller is made from. Constant after init: it is copied into the block, with the arrays of priors,
 *  effects, bounds, cost terms, outputs, gains and sensor limits that it points to; the model's table, the mixture,
 *  networks and the rows of references and demonstrations are the caller's. The host tools write it from a robot file; see
 *  docs/reference/robot_file.md. C++ fills one with its arrays by tiller::Config (tiller/config.hpp). */
typedef struct tiller_config {
  uint32_t size;    /**< sizeof(tiller_config_t) */
  uint32_t version; /**< TILLER_CONFIG_VERSION */
  const tiller_model_t* model;
  uint64_t seed; /**< of every random number: same seed, same inputs, same commands */

  double period_s;     /**< of the control tick, 1e-4..1 */
  uint32_t substeps;   /**< integrator steps per period, 1..64 */
  uint32_t integrator; /**< tiller_integrator_t */
  tiller_body_t body;  /**< gravity in [-100, 100] m/s^2; payload_kg and payload_kgm2 in [0, 1e6] */

  uint32_t effect_count;
  uint32_t param_count;           /**< model parameters + effect parameters */
  const tiller_effect_t* effects; /**< (effect_count) */
  const tiller_prior_t* priors;   /**< (param_count) of the model's parameters, then of the effects' */

  uint32_t measurement_count;                      /**< ny */
  uint32_t record_ticks;                           /**< ticks kept in the block, 0..65536 */
  uint8_t measured_state[TILLER_MAX_MEASUREMENTS]; /**< (ny) index of the state that each measurement reads */
  double measurement_sd[TILLER_MAX_MEASUREMENTS];  /**< of the sensor, quantisation included; scales */
  double process_sd[TILLER_MAX_STATES];            /**< random change of the state that the model does not explain,
                                              per square root of a second; same unit as the state. Scales, or 0: the
                                              model explains the state exactly (`conjugate` needs one above 0) */
  double initial_state[TILLER_MAX_STATES];         /**< expected at the first measurement; values */
  double initial_state_sd[TILLER_MAX_STATES];      /**< and how sure that is; scales, or 0 */

  tiller_posterior_config_t posterior;
  const tiller_mixture_t* prior_mixture; /**< joint prior in the place of the marginals; null: none */
  const tiller_network_t* network;       /**< of the effects `network` and `gaussian_process`; null: none */
  const tiller_policy_t* policy;         /**< of the planner `policy`; null: none */
  tiller_planner_config_t planner;
  tiller_probe_config_t probe;
  tiller_cost_config_t cost;
  tiller_safety_config_t safety;
} tiller_config_t;

/** Fills every field with a documented default for a model: RK4, one substep, MPPI, no effects, no priors (null:
 *  refused by tiller_init where the model has parameters), no bounds, no terms, command limits zero. Without a model (NULL, because
 *  tiller_find_model found none) no_model, which every use of the configuration then says too. */
tiller_status_t tiller_config_default(tiller_config_t* config, const tiller_model_t* model);

/** Checks a configuration: the first reason against it, and the name of the field in `field` (a literal). */
tiller_status_t tiller_config_check(const tiller_config_t* config, const char** field);

/** The caller's services; all may be null. */
typedef struct tiller_hooks {
  uint32_t size;    /**< sizeof(tiller_hooks_t) */
  uint32_t version; /**< TILLER_CONFIG_VERSION */
  void* context;
  /** Monotonic nanoseconds; needed for deadlines and for the tick times that tiller_info reports. */
  int64_t (*now_ns)(void* context);
  /** Runs work(arg, 0..n-1), in any order, on any threads, and returns when all are done. Null: a loop.
   *  The commands do not depend on it, to the last bit. */
  void (*parallel_for)(void* context, uint32_t n, void (*work)(void* arg, uint32_t index), void* arg);
} tiller_hooks_t;

/* ---- the controller ----------------------------------------------------------------------------- */

typedef struct tiller_controller tiller_t;

typedef enum tiller_state {
  tiller_state_init = 0,    /**< no measurement yet: safe command */
  tiller_state_standby = 1, /**< measuring and learning, safe command; waits for tiller_arm */
  tiller_state_active = 2,  /**< planning */
  tiller_state_hold = 3,    /**< planner unusable, sensors fresh: HOLD feedback */
  tiller_state_safe = 4     /**< latched safe command until tiller_reset */
} tiller_state_t;
const char* tiller_state_name(tiller_state_t state);

typedef struct tiller_measurement {
  int64_t stamp_us;                      /**< when the sensors were read */
  uint32_t sequence;                     /**< copied into the command that answers it */
  uint32_t command_latency_us;           /**< from the stamp to when the answering command takes hold, if known */
  double value[TILLER_MAX_MEASUREMENTS]; /**< (ny) NaN marks a missing value: it is skipped by the filter,
                                              and counted */
} tiller_measurement_t;

typedef struct tiller_command {
  int64_t stamp_us;                /**< now_us of the tick */
  uint32_t sequence;               /**< of the measurement that it answers */
  uint32_t state;                  /**< tiller_state_t after the tick */
  double value[TILLER_MAX_INPUTS]; /**< (nu) finite and within limits; in ACTIVE and HOLD within rate limits too
                                        (the safe command goes out at once, see docs/reference/safety.md) */
  uint32_t plan_sequence; /**< low 32 bits of tiller_info_t.plans. A device that sees ACTIVE with the same number for
                                        longer than its plan timeout has a hung planner behind a live sender */
  uint32_t reserved;
} tiller_command_t;

/** Whether the model can explain what is measured. */
typedef enum tiller_adequacy {
  tiller_adequacy_untested = 0, /**< switched off, or too few data yet */
  tiller_adequacy_adequate = 1,
  tiller_adequacy_inadequate = 2 /**< no parameter value explains a channel; until tiller_reset, or until a posterior
                                      that has learnt again explains it */
} tiller_adequacy_t;

/** The quantity that the normalised innovations of an inadequate model depend on. */
typedef enum tiller_feature {
  tiller_feature_none = 0,
  tiller_feature_bias = 1,          /**< a constant */
  tiller_feature_velocity = 2,      /**< the joint's velocity: viscous friction, drag */
  tiller_feature_velocity_sign = 3, /**< its sign: dry friction */
  tiller_feature_input = 4,         /**< the input: gain */
  tiller_feature_input_change = 5,  /**< the input's change: delay, lag */
  tiller_feature_previous = 6,      /**< the innovation before: anything that stays for a while */
  tiller_feature_size = 7,          /**< larger than the configured noise, or growing */
  tiller_feature_position = 8,      /**< the joint's position: a spring, gravity */
  tiller_feature_count
} tiller_feature_t;
/** The feature's name, e.g. "velocity_sign"; "unknown" for one that does not exist. */
const char* tiller_feature_name(tiller_feature_t feature);

/** What the command of a tick is for, beside the task. */
typedef enum tiller_probing {
  tiller_probing_none = 0,     /**< the plan as it would be without probing */
  tiller_probing_plan = 1,     /**< a plan that also finds out */
  tiller_probing_calibrate = 2 /**< the motion that tiller_calibrate asked for */
} tiller_probing_t;

/** The state of a controller after a tick. Counters never decrease and wrap at 2^64. */
typedef struct tiller_info {
  uint64_t ticks;
  uint32_t state;              /**< tiller_state_t */
  int32_t status;              /**< tiller_status_t of the last tick */
  int32_t first_fault;         /**< tiller_status_t that led to SAFE or HOLD; ok if none */
  uint32_t planner_iterations; /**< completed in the last tick; ilqr, sqp, hybrid: with those of the scout */
  double plan_cost;            /**< of the chosen plan, under the configured risk; INFINITY: this tick made none */
  double effective_samples;    /**< of the posterior, 1..N */
  double likelihood_exponent;  /**< 1 once all data are taken in at full weight */
  double noise_scale;          /**< estimated noise over configured noise, standard deviations */
  double acceptance;           /**< share of accepted moves, running mean */
  uint64_t resamplings;
  int64_t tick_ns, posterior_ns, plan_ns; /**< of the last tick; 0 without hooks.now_ns */
  double state_mean[TILLER_MAX_STATES];
  double state_sd[TILLER_MAX_STATES];
  double param_mean[TILLER_MAX_PARAMS];
  double param_sd[TILLER_MAX_PARAMS];
  uint64_t rejected_measurements;         /**< whole measurements that the guard refused */
  uint64_t missing_values;                /**< NaN in measurements that were taken in */
  uint64_t late_plans;                    /**< ticks whose deadline left no time for a single iteration */
  uint64_t gate_clipped, gate_rejections; /**< commands cut to a limit; commands with NaN or infinity */
  uint64_t plan_failures;                 /**< ticks without a finite plan, or with a plan that was used up */
  uint64_t posterior_failures; /**< updates that no particle took in, and filters started again after a pause */
  uint32_t adequacy;           /**< tiller_adequacy_t */
  uint32_t inadequate_channel; /**< index of the measurement whose innovations gave the alarm */
  uint32_t inadequate_feature; /**< tiller_feature_t */
  uint32_t plan_lead;          /**< periods from the last plan's measurement to when its first command takes effect */
  double adequacy_statistic;   /**< largest test statistic over its threshold: above 1 is an alarm */
  double noise_sd[TILLER_MAX_STATES]; /**< estimated, as process_sd; zero where the engine has no estimate per state */
  double delay_weight[TILLER_MAX_HYPOTHESES];      /**< of input delays nearest to 0, 1, .. periods */
  double forgetting_weight[TILLER_MAX_FORGETTING]; /**< of the configured rates */
  double discrepancy_share;  /**< of the residuals' squares that the discrepancy basis takes up, 0..1 */
  uint64_t plans;            /**< finite plans that the planner has made; stands still while it does not get that far */
  uint64_t relearned;        /**< times that the posterior began to learn again because the robot seemed changed */
  uint64_t lost_transitions; /**< transitions that no longer judge moves: no finite step near the particles */
  uint32_t force_joints;     /**< the first joints of the model, whose forces beyond it are estimated; 0: none are */
  uint32_t touched;          /**< bit j: the force at joint j is beyond safety.contact_force */
  double force_mean[TILLER_MAX_JOINTS]; /**< N or N m: what pushes joint j beyond the model and its own friction */
  double force_sd[TILLER_MAX_JOINTS];
  double drift_evidence[TILLER_MAX_DRIFTS]; /**< of the parameters of posterior.drift, in their order: logarithm of how
                                                 much likelier the data make a walk than none */
  double jump_evidence[TILLER_MAX_DRIFTS];  /**< the same, of one jump than of none */
  double jump_age_s[TILLER_MAX_DRIFTS];     /**< how long ago the likeliest jump was */
  double jump_by[TILLER_MAX_DRIFTS];        /**< and how large, in the parameter's unit */
  double viscous_mean[TILLER_MAX_JOINTS];   /**< N s/m or N m s: friction at joint j beyond the model's that grows with
                                                  speed; 0 where none is looked for */
  double viscous_sd[TILLER_MAX_JOINTS];
  double dry_mean[TILLER_MAX_JOINTS]; /**< N or N m: dry friction at joint j beyond the model's */
  double dry_sd[TILLER_MAX_JOINTS];
  uint64_t slip_states;                /**< bit i: a slip of state i is estimated */
  double slip_mean[TILLER_MAX_STATES]; /**< of state i a second: what changes it beyond the model */
  double slip_sd[TILLER_MAX_STATES];
  uint32_t probing;            /**< tiller_probing_t of this tick's command */
  uint32_t calibration_left;   /**< periods of tiller_calibrate that are still to come */
  uint64_t probed_ticks;       /**< whose command was of a probing plan */
  double probe_value;          /**< what the last plan that was tried is expected to save, in units of the cost */
  double probe_cost;           /**< and to add to the cost */
  double probe_spent;          /**< of all probing since motion began, as it was expected */
  double probe_allowed;        /**< what the budget has come to since then */
  double probe_information;    /**< nats that the last calibrating or probing plan is expected to tell of the parameters */
} tiller_info_t;

/** Exact bytes that tiller_init needs; 0 if the configuration is not valid (tiller_config_check says why). */
size_t tiller_size(const tiller_config_t* config);

/** Lays a controller out in `memory` (the caller's, aligned to TILLER_ALIGNMENT, alive as long as *t) and
 *  draws the particles from the priors. `hooks` may be null. Afterwards the state is INIT. */
tiller_status_t tiller_init(tiller_t** t, const tiller_config_t* config, const tiller_hooks_t* hooks, void* memory,
                            size_t size);

/** Permits motion: INIT or STANDBY -> planning begins with the next valid measurement. */
tiller_status_t tiller_arm(tiller_t* t);
/** Stops motion: -> STANDBY with the safe command. From SAFE: wrong_state. */
tiller_status_t tiller_disarm(tiller_t* t);
/** Latches SAFE at once, for reasons that only the caller sees (emergency stop, actuator fault, bus-off). */
tiller_status_t tiller_stop(tiller_t* t, tiller_status_t why);
/* A goal may change at any time between two ticks; the next plan pursues it. Nothing is allocated, and nothing that was
 * learned is touched. Weights stay those of the configuration: an output or a state without one has no say. What is
 * not a value is refused with bad_cost, and the goal stays. `terminal = lqr` keeps the matrix of the first target. */

/** Where to go, in states (nx); ends a reference of states. HOLD's feedback aims there too. */
tiller_status_t tiller_set_target(tiller_t* t, const double* target);
/** Where to bring the model's outputs (ny); ends a reference of outputs. bad_cost where the configuration weighs no
 *  outputs. */
tiller_status_t tiller_set_output_target(tiller_t* t, const double* target);
/** Rows to follow: `states` (steps x nx) and `outputs` (steps x ny), either may be null: its targets hold then. Row 0
 *  is due at the next tick, the last row holds; time_s of an own cost begins again. The arrays are not copied: they
 *  outlive the controller or the next goal. Time: one look at each value. steps is 1 at least; to end a reference, set
 *  a target. */
tiller_status_t tiller_set_reference(tiller_t* t, const double* states, const double* outputs, uint32_t steps);
/** The model's outputs y (ny) at the present estimate of state and parameters. bad_model where it has none. */
tiller_status_t tiller_get_outputs(const tiller_t* t, double* y);
/** Leaves SAFE: -> INIT, disarmed. The posterior over the parameters is kept; the state estimate starts again. */
tiller_status_t tiller_reset(tiller_t* t);

/** Does now what the next tick's plan needs and can be done without its measurement (gradient planners: shift,
 *  linearise, factorise), so that the tick itself is short: Diehl's real-time iteration, split into preparation and
 *  feedback. Optional; call it after the command was sent. Planners without a preparation do nothing. */
tiller_status_t tiller_prepare(tiller_t* t);

/** Where a calibration may move: closed intervals. Of states it is kept with the probability of probe.risk, under the
 *  posterior and the noise; of inputs always. */
typedef struct tiller_box {
  uint32_t size;            /**< sizeof(tiller_box_t) */
  uint32_t version;         /**< TILLER_CONFIG_VERSION */
  const double* state_low;  /**< (nx) values, -INFINITY for none; null: none, or the cost's bounds */
  const double* state_high; /**< (nx) likewise */
  const double* input_low;  /**< (nu) values; null: the limits */
  const double* input_high; /**< (nu) likewise */
} tiller_box_t;

/** The next `periods` in which the robot moves are for learning: the motion that tells most of the parameters inside of
 *  the box, planned anew in every tick, before the task begins (row 0 of a reference is due after it). It ends early
 *  once probe.until_sd is reached, with an alarm of the adequacy test, and with motion itself. Where no motion stays in
 *  the box, the one that leaves it least is sent; a tick without time to look has the planner's command, cut to the box.
 *  The box is copied; 0 periods end a calibration. bad_planner without a prober (probe.weight 0),
 *  bad_limit for a box that is empty or outside of the limits, wrong_state in SAFE. */
tiller_status_t tiller_calibrate(tiller_t* t, const tiller_box_t* box, uint32_t periods);

/** One control period. `measurement` may be null (nothing new). Always fills *command.
 *  Returns the first reason why the command is not an unlimited fresh plan, else model_inadequate, else ok.
 *  Cost: bounded by the configuration; see tiller_info and `./dev bench rollout`. */
tiller_status_t tiller_tick(tiller_t* t, int64_t now_us, const tiller_measurement_t* measurement,
                            tiller_command_t* command);

/** For replay: the next tick's planner does the `planner_iterations` of a record, whatever the clock says. */
tiller_status_t tiller_force_iterations(tiller_t* t, uint32_t iterations);

void tiller_get_info(const tiller_t* t, tiller_info_t* info);
/** Full covariance of the parameters, (np x np) row-major, zero rows for fixed ones. Cost: O(N np^2). */
tiller_status_t tiller_get_covariance(const tiller_t* t, double* covariance);
/** Weighted quantile q in [0, 1] of parameter `param`. Cost: O(N log N). */
tiller_status_t tiller_get_quantile(const tiller_t* t, uint32_t param, double q, double* value);
/** How much the data have narrowed each direction of the parameters: the generalised eigenvectors of the posterior's
 *  covariance against the prior's, in the parameters' coordinates, least known first. variance_ratio (d): posterior
 *  over prior, near 1 where the data say nothing; direction (d x np, row-major): in units of each parameter's prior
 *  deviation, length one, zero for fixed parameters. Both nullable; *d is the number of inferred parameters. Cost: O(N d^2 + d^3). */
tiller_status_t tiller_get_contraction(const tiller_t* t, uint32_t* d, double* variance_ratio, double* direction);
/** The planned inputs, (horizon x nu) row-major, first the one in force. Returns the number of steps copied. */
uint32_t tiller_get_plan(const tiller_t* t, double* inputs, uint32_t steps);
/** Feedback around the plan, from planners that have it (ilqr, sqp, hybrid; with closed_loop mppi, cem, random_shooting):
 *  u = input + gain (x - state) for plan step `step`. gain (nu x nx, row-major), state (nx), input (nu), each nullable.
 *  bad_planner where the planner has none, bad_dimension past the horizon. It is the planner's, also in ticks that send
 *  another sequence (tiller_info_t.probing). */
tiller_status_t tiller_get_feedback(const tiller_t* t, uint32_t step, double* gain, double* state, double* input);
/** The state `step` periods after the last plan's first command takes effect, under its inputs and its feedback (where
 *  the planner has one): mean (nx) and standard deviation (nx), of the particles, of the state's estimate and of the
 *  process noise; either may be null. Angles go on without wrapping. bad_planner without planner.predict_spread,
 *  wrong_state before the first plan, bad_dimension past the horizon. The plan has computed it: this copies. */
tiller_status_t tiller_get_prediction(const tiller_t* t, uint32_t step, double* mean, double* sd);
/** One particle: params (np), state (nx), normalised weight; any pointer may be null. */
tiller_status_t tiller_get_particle(const tiller_t* t, uint32_t index, double* params, double* state, double* weight);

/** Calls between two ticks, as tiller_record_t.calls keeps it. */
typedef enum tiller_call {
  tiller_call_none = 0,
  tiller_call_arm = 1,
  tiller_call_disarm = 2,
  tiller_call_stop = 3,
  tiller_call_reset = 4,
  tiller_call_prepare = 5,
  tiller_call_goal = 6, /**< tiller_set_target and its like; what the goal was, the caller keeps */
  tiller_call_calibrate = 7, /**< likewise its box and periods */
  tiller_call_lost = 15 /**< more than eight calls before one tick: the rest were not kept */
} tiller_call_t;

/** A recorded tick: every input and output, enough to replay it bit by bit. */
typedef struct tiller_record {
  uint64_t tick;
  int64_t now_us;
  tiller_measurement_t measurement;
  tiller_command_t command;
  int32_t status;
  uint32_t has_measurement;
  uint32_t planner_iterations;
  uint32_t calls; /**< accepted tiller_arm/disarm/stop/reset/prepare/set_... since the tick before, four bits each
                                    (tiller_call_t), the first in the lowest */
  double plan_cost, effective_samples, noise_scale;
  int64_t tick_ns;
  double state_mean[TILLER_MAX_STATES];
  double param_mean[TILLER_MAX_PARAMS];
  double param_sd[TILLER_MAX_PARAMS];
} tiller_record_t;

/** Copies the record of tick `tick` (0 is the first) if the ring still holds it. */
tiller_status_t tiller_get_record(const tiller_t* t, uint64_t tick, tiller_record_t* record);

/** Name of the instruction set that this process runs ("avx512", "avx2", "sse2", "neon", "scalar"). */
const char* tiller_instruction_set(void);
/** "major.minor" of the library. */
const char* tiller_version(void);

#ifdef __cplusplus
}
#endif
#endif
