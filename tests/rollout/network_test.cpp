// Forces that a network has learnt: its values against plain loops, its place in a step against effects and
// differences, and what is refused.

#include "networks/evaluate.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "batch.hpp"
#include "networks/network_check.hpp"

namespace tiller {
namespace {

struct OwnNetwork {
  tiller_network_t network = {};
  std::vector<float> weights;

  OwnNetwork(tiller_network_kind_t kind, std::uint32_t inputs, std::uint32_t outputs, std::uint32_t members,
             std::uint32_t first, std::uint32_t second, double size = 1.0) {
    network.size = sizeof network;
    network.version = TILLER_CONFIG_VERSION;
    network.kind = kind;
    network.inputs = inputs;
    network.outputs = outputs;
    network.members = members;
    network.hidden[0] = first;
    network.hidden[1] = second;
    weights.resize(network_weight_count(network));
    Rng rng(7, 8, 9);
    for (float& w : weights) w = static_cast<float>(size * (2.0 * rng.uniform() - 1.0));
    network.weights = weights.data();
    network.weight_count = static_cast<std::uint32_t>(weights.size());
  }
  OwnNetwork(const OwnNetwork&) = delete;
  /// All zero but the biases of the outputs, which are `bias` times one more than the member's number.
  void keep_biases(double bias) {
    std::fill(weights.begin(), weights.end(), 0.0f);
    const std::size_t each = weights.size() / network.members;
    const std::size_t last = network.hidden[1] ? network.hidden[1] : network.hidden[0];
    for (std::uint32_t m = 0; m < network.members; ++m)
      for (std::uint32_t o = 0; o < network.outputs; ++o)
        weights[(m + 1) * each - (network.outputs - o) * (last + 1)] = static_cast<float>(bias * (m + 1));
  }
};

/// The perceptron's definition, with the C library's tanh.
std::vector<double> tanh_reference(const OwnNetwork& n, std::uint32_t member, std::vector<double> x) {
  std::vector<std::uint32_t> widths;
  for (const std::uint32_t h : n.network.hidden)
    if (h > 0) widths.push_back(h);
  widths.push_back(n.network.outputs);
  std::size_t at = member * (n.weights.size() / n.network.members);
  for (std::size_t l = 0; l < widths.size(); ++l) {
    std::vector<double> y;
    for (std::uint32_t r = 0; r < widths[l]; ++r) {
      double sum = static_cast<double>(n.weights[at++]);
      for (const double value : x) sum += static_cast<double>(n.weights[at++]) * value;
      y.push_back(l + 1 < widths.size() ? std::tanh(sum) : sum);
    }
    x = y;
  }
  return x;
}

std::vector<double> some_inputs(std::uint32_t count) {
  std::vector<double> x;
  for (std::uint32_t i = 0; i < count; ++i) x.push_back(1.5 * std::sin(1.0 + 2.3 * i));
  return x;
}

TEST(Network, TanhIsTheCLibrarysToTwoMillionths) {
  for (double x = -30.0; x <= 30.0; x += 1e-3) {
    double all[5] = {x, 0.3, -x, 2.0, x};  // four share a division, the fifth has its own
    tanh_all(all, 5);
    ASSERT_NEAR(all[0], std::tanh(x), 2.1e-6) << x;
    ASSERT_NEAR(all[2], std::tanh(-x), 2.1e-6) << x;
    ASSERT_NEAR(all[4], std::tanh(x), 2.1e-6) << x;
  }
}

TEST(Network, IsItsDefinitionForEveryShape) {
  for (const auto& shape : {std::pair{0u, 0u}, {3u, 0u}, {16u, 16u}, {5u, 7u}}) {
    const OwnNetwork n(tiller_network_tanh, 5, 3, 4, shape.first, shape.second);
    for (std::uint32_t member = 0; member < 4; ++member) {
      const std::vector<double> x = some_inputs(5), wanted = tanh_reference(n, member, x);
      double out[3];
      evaluate_network(n.network, static_cast<double>(member) + 0.5, x.data(), out);
      for (int o = 0; o < 3; ++o) EXPECT_NEAR(out[o], wanted[static_cast<std::size_t>(o)], 1e-4) << shape.first;
    }
  }
}

TEST(Network, GaussianFeaturesAreTheirDefinition) {
  const OwnNetwork n(tiller_network_gaussian, 2, 1, 2, 3, 2);
  const float* w = n.weights.data();
  const double x[2] = {0.4, -0.7};
  for (std::size_t member = 0; member < 2; ++member) {
    const float* own = w + 2 + 6 + 6 + member * 6;
    double sum = static_cast<double>(own[0]);
    for (std::size_t c = 0; c < 3; ++c) {
      double square = 0.0;
      for (std::size_t i = 0; i < 2; ++i)
        square += std::pow(static_cast<double>(w[i]) * (x[i] - static_cast<double>(w[2 + 2 * c + i])), 2);
      sum += static_cast<double>(own[1 + c]) * std::exp(-0.5 * square);
    }
    for (std::size_t k = 0; k < 2; ++k) {
      const float* wave = w + 8 + 3 * k;
      const double phase =
          static_cast<double>(wave[0]) + static_cast<double>(wave[1]) * x[0] + static_cast<double>(wave[2]) * x[1];
      sum += static_cast<double>(own[4 + k]) * std::cos(phase);
    }
    double out[1];
    evaluate_network(n.network, static_cast<double>(member), x, out);
    EXPECT_NEAR(out[0], sum, 1e-12);
  }
}

TEST(Network, MembersBeyondTheEndsAreTheFirstAndTheLast) {
  OwnNetwork n(tiller_network_tanh, 1, 1, 3, 4, 0);
  n.keep_biases(1.0);
  const double x[1] = {0.0};
  for (const auto& [member, wanted] :
       {std::pair{-4.0, 1.0}, {0.0, 1.0}, {0.999, 1.0}, {1.0, 2.0}, {2.999, 3.0}, {3.0, 3.0}, {50.0, 3.0}}) {
    double out[1];
    evaluate_network(n.network, member, x, out);
    EXPECT_EQ(out[0], wanted) << member;
  }
}

TEST(Network, DerivativesAreThoseOfDifferences) {
  for (const tiller_network_kind_t kind : {tiller_network_tanh, tiller_network_gaussian}) {
    const OwnNetwork n(kind, 3, 2, 2, 6, 5);
    using D = Dual<double, 3>;
    std::vector<double> x = some_inputs(3);
    D in[3], out[2];
    for (int i = 0; i < 3; ++i) in[i] = D::seed(x[static_cast<std::size_t>(i)], i);
    evaluate_network(n.network, D(1.0), in, out);
    for (std::size_t i = 0; i < 3; ++i) {
      double above[2], below[2];
      constexpr double kStep = 1e-5;
      x[i] += kStep;
      evaluate_network(n.network, 1.0, x.data(), above);
      x[i] -= 2.0 * kStep;
      evaluate_network(n.network, 1.0, x.data(), below);
      x[i] += kStep;
      // the fit of tanh has the slope of tanh to 1e-5
      for (int o = 0; o < 2; ++o) EXPECT_NEAR(out[o].d[i], (above[o] - below[o]) / (2.0 * kStep), 2e-4);
    }
  }
}

/// A configuration with a network of the model's shape, and room for the members' parameter.
tiller::Config with_network(const tiller_model_t* model, const OwnNetwork& n) {
  tiller::Config config = plain_config(model);
  config.network = &n.network;
  add_effect(config, n.network.kind == tiller_network_tanh ? tiller_effect_network : tiller_effect_gaussian_process, 0);
  return config;
}

TEST(NetworkEffect, AConstantIsTheConstantOffset) {
  for (const tiller_model_t* model : all_models()) {
    if (model->joint_count == 0) continue;
    OwnNetwork n(tiller_network_tanh, network_input_count(*model), model->joint_count, 1, 4, 4);
    n.keep_biases(0.25);
    for (const Isa isa : all_isas()) {
      tiller::Config offset = plain_config(model);
      for (std::uint32_t j = 0; j < model->joint_count; ++j) add_effect(offset, tiller_effect_constant_offset, j);
      Batch<double> a(with_network(model, n), 16, 20), b(offset, 16, 20);
      a.set_param(model->param_count, 0.0);
      for (std::uint32_t j = 0; j < model->joint_count; ++j) b.set_param(model->param_count + j, 0.25);
      a.run(*model, select_rollout(*model, isa));
      b.run(*model, select_rollout(*model, isa));
      for (std::size_t i = 0; i < a.final_state.size(); ++i)
        ASSERT_NEAR(a.final_state[i], b.final_state[i], 1e-9) << model->name << " " << isa_name(isa);
    }
  }
}

TEST(NetworkEffect, EachLaneHasItsMember) {
  const tiller_model_t* model = tiller_find_model("pendulum");
  OwnNetwork n(tiller_network_tanh, network_input_count(*model), 1, 5, 4, 0);
  n.keep_biases(0.1);
  Batch<float> all(with_network(model, n), 16, 10);
  for (std::uint32_t l = 0; l < 16; ++l) all.params[model->param_count * 16 + l] = static_cast<float>(l % 5) + 0.3f;
  all.run(*model, select_rollout(*model));
  for (std::uint32_t member = 0; member < 5; ++member) {
    Batch<float> one(with_network(model, n), 16, 10);
    one.set_param(model->param_count, member + 0.9);
    one.run(*model, select_rollout(*model));
    for (std::uint32_t l = member; l < 16; l += 5) EXPECT_EQ(all.final_state[l], one.final_state[l]);
  }
}

TEST(NetworkEffect, TemplateAndTableAgree) {
  for (const tiller_network_kind_t kind : {tiller_network_tanh, tiller_network_gaussian}) {
    const tiller_model_t* model = tiller_find_model("cart_pole");
    const tiller_model_t plain = as_c_model(*model);
    const OwnNetwork n(kind, network_input_count(*model), model->joint_count, 2, 8, 4, 0.5);
    Batch<double> a(with_network(model, n), 16, 10), b(with_network(model, n), 16, 10);
    a.run(*model, select_rollout(*model));
    b.run(plain, select_rollout(plain));
    for (std::size_t i = 0; i < a.final_state.size(); ++i) EXPECT_NEAR(a.final_state[i], b.final_state[i], 1e-11);
  }
}

TEST(NetworkEffect, TheJacobianIsThatOfDifferences) {
  for (const char* name : {"pendulum", "cart_pole", "planar_quadrotor"}) {
    const tiller_model_t* model = tiller_find_model(name);
    const std::uint32_t nx = model->state_count, nu = model->input_count;
    const OwnNetwork n(tiller_network_tanh, network_input_count(*model), model->joint_count, 1, 16, 16, 0.5);
    const tiller::Config config = with_network(model, n);
    std::vector<double> state(nx), control(nu, 0.3), params(TILLER_MAX_PARAMS, 0.7), rest(TILLER_MAX_STATES, 0.0);
    for (std::uint32_t i = 0; i < nx; ++i) state[i] = 0.4 * std::cos(2.0 * i);
    StepSetup setup;
    ASSERT_EQ(make_step_setup(config, setup), tiller_status_ok);
    std::vector<double> next(nx * 16), a(nx * nx * 16), b(nx * nu * 16);
    LineariseJob job;
    job.setup = &setup;
    job.lanes = 16;
    job.state = {state.data(), 0};
    job.params = {params.data(), 0};
    job.effect_state = {rest.data(), 0};
    job.control = {control.data(), 0};
    job.next_state = next.data();
    job.a = a.data();
    job.b = b.data();
    const RolloutTable& table = select_rollout(*model);
    table.linearise(*model, job);
    const std::vector<double> slopes = a;
    for (std::uint32_t c = 0; c < nx; ++c) {
      constexpr double kStep = 1e-5;
      state[c] += kStep;
      table.linearise(*model, job);
      const std::vector<double> above = next;
      state[c] -= 2.0 * kStep;
      table.linearise(*model, job);
      state[c] += kStep;
      for (std::uint32_t r = 0; r < nx; ++r)
        EXPECT_NEAR(slopes[(r * nx + c) * 16], (above[r * 16] - next[r * 16]) / (2.0 * kStep), 1e-5) << name << r << c;
    }
  }
}

TEST(NetworkEffect, RefusesWhatDoesNotFit) {
  const tiller_model_t* model = tiller_find_model("cart_pole");
  const OwnNetwork good(tiller_network_tanh, network_input_count(*model), 2, 2, 4, 0);
  const OwnNetwork narrow(tiller_network_tanh, network_input_count(*model) - 1, 2, 2, 4, 0);
  const OwnNetwork gaussian(tiller_network_gaussian, network_input_count(*model), 2, 2, 4, 0);
  StepSetup setup;
  tiller::Config config = with_network(model, good);
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_ok);
  config.network = nullptr;
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config.network = &narrow.network;
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config.network = &gaussian.network;
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect);
  config.network = &good.network;
  add_effect(config, tiller_effect_network, 0);
  EXPECT_EQ(make_step_setup(config, setup), tiller_status_bad_effect) << "one network cannot stand twice";
}

/// One value beyond what the header allows, at a time.
TEST(NetworkCheck, NamesEveryFieldThatIsBeyondItsRange) {
  using N = tiller_network_t;
  const struct {
    const char* field;
    tiller_network_kind_t kind;
    void (*spoil)(N&);
  } cases[] = {
      {"size", tiller_network_tanh, [](N& n) { --n.size; }},
      {"kind", tiller_network_tanh, [](N& n) { n.kind = tiller_network_gaussian + 1; }},
      {"inputs", tiller_network_tanh, [](N& n) { n.inputs = 0; }},
      {"inputs", tiller_network_tanh, [](N& n) { n.inputs = TILLER_MAX_NETWORK_INPUTS + 1; }},
      {"outputs", tiller_network_tanh, [](N& n) { n.outputs = 0; }},
      {"outputs", tiller_network_tanh, [](N& n) { n.outputs = TILLER_MAX_NETWORK_OUTPUTS + 1; }},
      {"members", tiller_network_tanh, [](N& n) { n.members = 0; }},
      {"members", tiller_network_tanh, [](N& n) { n.members = TILLER_MAX_NETWORK_MEMBERS + 1; }},
      {"hidden", tiller_network_tanh, [](N& n) { n.hidden[0] = 0; }},  // a second layer without a first
      {"hidden", tiller_network_tanh, [](N& n) { n.hidden[0] = TILLER_MAX_NETWORK_WIDTH + 1; }},
      {"hidden", tiller_network_tanh, [](N& n) { n.hidden[1] = TILLER_MAX_NETWORK_WIDTH + 1; }},
      {"hidden", tiller_network_gaussian, [](N& n) { n.hidden[0] = n.hidden[1] = 0; }},
      {"hidden", tiller_network_gaussian, [](N& n) { n.hidden[0] = TILLER_MAX_NETWORK_FEATURES + 1; }},
      {"hidden", tiller_network_gaussian, [](N& n) { n.hidden[1] = TILLER_MAX_NETWORK_FEATURES + 1; }},
      {"hidden", tiller_network_gaussian, [](N& n) { n.hidden[0] = n.hidden[1] = TILLER_MAX_NETWORK_FEATURES; }},
      {"weight_count", tiller_network_tanh, [](N& n) { ++n.weight_count; }},
      {"weights", tiller_network_tanh, [](N& n) { n.weights = nullptr; }},
  };
  for (const auto& c : cases) {
    OwnNetwork own(c.kind, 3, 2, 2, 6, 5);
    ASSERT_EQ(network_defect(own.network), nullptr);
    c.spoil(own.network);
    EXPECT_STREQ(network_defect(own.network), c.field);
  }
}

TEST(NetworkCheck, NamesTheField) {
  OwnNetwork n(tiller_network_tanh, 3, 2, 2, 4, 4);
  EXPECT_EQ(network_defect(n.network), nullptr);
  n.weights[5] = NAN;
  EXPECT_STREQ(network_defect(n.network), "weights");
  n.weights[5] = 1e10f;
  EXPECT_STREQ(network_defect(n.network), "weights");
  n.weights[5] = 0.0f;
  n.network.weight_count += 1;
  EXPECT_STREQ(network_defect(n.network), "weight_count");
  n.network.weight_count -= 1;
  n.network.hidden[0] = 0;
  EXPECT_STREQ(network_defect(n.network), "hidden");
  n.network.hidden[0] = TILLER_MAX_NETWORK_WIDTH + 1;
  EXPECT_STREQ(network_defect(n.network), "hidden");
  n.network.members = 0;
  EXPECT_STREQ(network_defect(n.network), "members");
  n.network.version = 1;
  EXPECT_STREQ(network_defect(n.network), "version");
}

}  // namespace
}  // namespace tiller
