#pragma once

// Every threshold of `tiller gap`, with its reason; docs/evidence/gap_thresholds.md has the rules that use them.

#include <cstddef>
#include <cstdint>

namespace tiller::tools::gap {

// ---- windows -------------------------------------------------------------------------------------
constexpr double kWindow_s = 1.0;        // what is fitted: long enough to see friction, short enough to stay on path
constexpr double kSubstep_s = 0.0025;    // of the integrator at most: friction is split off the free step
constexpr double kSubstepRate = 0.15;    // of the fastest motion that a step takes where a state is behind a joint
constexpr double kRunIn_s = 0.25;        // commands that drive trains and delays see before a window
constexpr double kPathRunIn_s = 1.0;     // of bristles and play, along the measured path
constexpr double kFollowRunIn_s = 5.0;   // of lags, by commands alone: one of a second has forgotten all but 1 %
constexpr double kMemoryRunIn_s = 30.0;  // of rate limits and supplies: a limit may never catch up with the command
constexpr std::size_t kMemoryRunInPeriods = 3000;  // what that may cost; at least the lags' time
constexpr double kRestLook_s = 0.1;                // over which a vehicle's place tells whether a log begins at rest
constexpr double kStateHalfWidth_s = 0.03;         // parabola of the first guess of a window's state
constexpr std::size_t kManyParams = 8;             // of the robot file: with more, pieces of windows are fitted first
constexpr double kBrief_s = 0.1;                   // of such a piece: before a wrong friction has left the path
constexpr double kTestShare = 0.15;                // of the windows, kept for the proof
constexpr double kLeast_s = 4.0;                   // of windows: with less nothing is decided
constexpr double kShortestHoldout_s = 0.25;        // lengths of the rollouts kept for the proof
constexpr double kHoldout_s = 1.0;
constexpr double kLongestHoldout_s = 3.0;

// ---- screen --------------------------------------------------------------------------------------
constexpr double kPitchStep = 0.3;                 // periods over the whole excursion between the pitches of a scan
constexpr double kSpatialPeriodNoise = 4;          // sensor deviations in the shortest pitch of a scan
constexpr std::size_t kMostPitches = 400;          // of a scan; where a longer one is due, orders of a turn
constexpr std::size_t kMostGearPitches = 4000;     // of a scan through a gear, whose ratio is not known
constexpr double kLeastRepeats = 2;                // of a period in the travel: what is not seen twice does not repeat
constexpr std::size_t kPitchStarts = 4;            // peaks of a scan that are fitted
constexpr std::size_t kScreenWindows = 12;         // of the working windows, evenly
constexpr int kMostStarts = 8;                     // of an effect at a port
constexpr double kSmallStarts[2] = {0.05, 0.002};  // of a start: further ones that stay near the nominal path
constexpr double kFarFromPrior_sd = 2.576;  // of the model's own parameters: where the report tells it too (99.5 %)
constexpr double kAtBound = 1e-3;           // of a parameter's range: what stands so near its end was driven there
constexpr double kAnotherValley = 2;        // a parameter over its prior's centre, or the other way round
constexpr int kFromCentreIterations = 3;    // of a fit from the priors' centre, which begins farther off
constexpr double kOtherLimits[4] = {0.12, 1.6, 2.5, 8};  // further starts of limits, over the catalogue's largest
constexpr std::size_t kPolished = 3;                     // of them, fitted again from other shapes
constexpr double kMostStrength = 30;                     // of a strength, over what is typical of the data
constexpr double kMostStiffness = 1e4;                   // of a contact or a drive train, which is no strength: rigid
constexpr double kLeastRecovery = 10;  // periods of a supply: without memory it bends as load friction does
constexpr double kMostPeriods = 3000;  // of a lag or a recovery: windows see next to nothing of a slower one
constexpr double kLeastShape = 0.01;   // of a shape's velocity, over what is typical
constexpr double kMostShape = 5;
constexpr std::size_t kKeep = 8;         // candidates that are fitted fully
constexpr std::uint32_t kFewJoints = 2;  // of more, a joint where no force reaches far enough is left out of a screen
constexpr double kLeastReach = 0.3;      // ... of what the best candidate takes off: half the error in amplitude
constexpr double kChanceReach = 3.0;     // ... standard deviations over what noise alone gives a force to take off
constexpr std::size_t kKeepMore = 5;     // the same beside an effect that is there already
constexpr std::size_t kBeam = 3;         // sets that the next level begins from
constexpr double kFitTolerance = 0.1;    // of the cost: an improvement below it ends a fit of the search
constexpr double kNoise_sigma = 1.05;  // what a pair leaves to be taken for whole before all starts of others are tried
constexpr int kFirstIterations = 4;    // after which a fit that is far behind is left as it is
constexpr double kStillInRace = 1.5;   // of the best cost: far behind is beyond it
constexpr double kPolishAgain = 1.05;  // of the cost on the screen's windows: other shapes that get so near are fitted
constexpr double kPromising = 1.3;     // of the best set's: what a set reaches on the screen's windows to be fitted
constexpr int kMostSwaps = 3;          // rounds in which the members of the best set are exchanged
constexpr std::size_t kMostSets = 128;  // of effects that are fitted to all windows: what memory is told for

// ---- decision ------------------------------------------------------------------------------------
constexpr double kPriorBend = 3;       // deviations from a prior up to which its cost is a Gaussian's
constexpr double kMostPrior_sd = 3;    // of a model's own parameter: further off, something acts as it does
constexpr double kLeastClip_nats = 4;  // of a window's difference
constexpr double kBehind_nats = 60;    // behind the best fit: not decided upon
constexpr double kGap_nats = 10;       // an effect against none: e^-10 times 40 candidates
constexpr double kGap_z = 3;
constexpr double kOpen_z = 1.5;     // with as many nats: neither proven nor refuted
constexpr double kRicher_nats = 5;  // a richer explanation against a special case of it
constexpr double kRicher_z = 2.5;
constexpr double kRival_nats = 4;  // the best against another of its size
constexpr double kRival_z = 1.5;
constexpr std::size_t kAnything = 3;  // sets that cannot be told apart: what they do not share is not known
constexpr double kSizeShare = 0.04;   // of the gap, in amplitude: what a further effect must explain
constexpr double kRivalShare = 0.25;  // of the gap: more than that apart is no rival, however few windows show it

// ---- what the logs cannot tell of the model itself ------------------------------------------------
constexpr double kUntold = 0.1;     // relative deviation from the data alone; told where the prior is narrower yet
constexpr double kTakesPart = 0.2;  // of the largest relative change in such a direction

// ---- the windows kept for the proof ----------------------------------------------------------------
constexpr double kKeptGap_z = 1;         // of a name against none there
constexpr double kKeptRicher_z = 0;      // against a special case of it; up to kKeptGap_z both are reported
constexpr double kBeyondChoice = 2;      // of the standard errors asked for: the choice among many cannot have made it
constexpr double kKeptRival_z = -1;      // against another explanation: one that they prefer by more is reported too
constexpr double kKeptBehind_nats = 60;  // on the working windows: further behind is not asked for

// ---- verdict -------------------------------------------------------------------------------------
constexpr double kWorseHoldout = 1.1;     // kept rollouts of any length that grow by more refute a name
constexpr double kWorseHoldout_z = 1;     // ... if they do so window by window: an unstable plant's run anywhere
constexpr double kExplained_sigma = 1.1;  // what "named" may leave
constexpr double kPartlyShare = 0.5;      // of the gap's square: what "partly explained" may leave
constexpr double kOtherInputs = 0.5;      // of the nominal cost: inputs read in another way that leave less are told
constexpr std::size_t kFewWindows = 10;   // a tenth of the windows
constexpr double kMostInFew = 0.8;        // of the gap's square in them: it is told where
constexpr double kSameSigma = 1.03;       // of the nominal model's: an effect that leaves up to that does the same
constexpr double kEquivalent_sigma =
    0.1;  // difference of predictions below which two explanations are one on these data

}  // namespace tiller::tools::gap
