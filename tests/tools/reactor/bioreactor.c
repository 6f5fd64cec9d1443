/* Growth on one substrate that inhibits itself (Haldane), in a vessel that is fed. */
#include <stddef.h>

#include "tiller/model.h"

enum { biomass, substrate, product, volume };
enum { mu_max, Ks, Ki, yield_x, yield_p, feed };

static void dynamics(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                     double* dxdt) {
  const double growth = p[mu_max] * x[substrate] / (p[Ks] + x[substrate] + x[substrate] * x[substrate] / p[Ki]);
  const double dilution = u[0] / x[volume];
  (void)f;
  (void)body;
  dxdt[biomass] = growth * x[biomass] - dilution * x[biomass];
  dxdt[substrate] = -growth * x[biomass] / p[yield_x] + dilution * (p[feed] - x[substrate]);
  dxdt[product] = p[yield_p] * growth * x[biomass] - dilution * x[product];
  dxdt[volume] = u[0];
}

static const char* const states[] = {"biomass_g_L", "substrate_g_L", "product_g_L", "volume_L"};
static const char* const inputs[] = {"feed_L_h"};
static const char* const params[] = {"mu_max_1_h", "Ks_g_L", "Ki_g_L", "yield_x", "yield_p", "feed_g_L"};

static const tiller_model_t model = {
    .size = sizeof(tiller_model_t),
    .version = TILLER_MODEL_VERSION,
    .name = "bioreactor",
    .state_count = 4,
    .input_count = 1,
    .param_count = 6,
    .state_names = states,
    .input_names = inputs,
    .param_names = params,
    .dynamics = dynamics,
};
const tiller_model_t* tiller_model(void);
const tiller_model_t* tiller_model(void) { return &model; }
