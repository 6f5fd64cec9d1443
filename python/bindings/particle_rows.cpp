#include "particle_rows.hpp"

#include "posterior/conjugate/conjugate_posterior.hpp"
#include "posterior/filter/filter_posterior.hpp"
#include "posterior/transition/transition_posterior.hpp"

namespace tiller::python {
namespace {

/// The engines keep their clouds to themselves, and on a robot nobody needs more: numpy alone looks without copying.
/// So the runtime offers no such look, and the name of the private member is taken where the language does not check
/// access: in the argument of an explicit instantiation ([temp.spec.general]). A renamed member fails to compile.
template <class Tag, auto Member>
struct Reveal {
  friend constexpr auto member_of(Tag) { return Member; }
};

struct FilterCloud {
  friend constexpr auto member_of(FilterCloud);
};
struct ConjugateCloud {
  friend constexpr auto member_of(ConjugateCloud);
};
template struct Reveal<FilterCloud, &tiller::FilterPosterior::cloud_>;
template struct Reveal<ConjugateCloud, &tiller::ConjugatePosterior::cloud_>;

ParticleRows rows_of(const tiller::Cloud& cloud) { return {cloud.params, cloud.weight}; }

bool is_bank(const tiller_config_t& config) {
  return config.posterior.kind == tiller_posterior_transition &&
         (config.posterior.delay_hypotheses > 1 || config.posterior.forgetting_count > 1);
}

}  // namespace

ParticleRows particle_rows(const tiller_config_t& config, const tiller::Posterior& posterior) {
  switch (config.posterior.kind) {
    case tiller_posterior_filter:
      return rows_of(static_cast<const tiller::FilterPosterior&>(posterior).*member_of(FilterCloud{}));
    case tiller_posterior_conjugate:
      return rows_of(static_cast<const tiller::ConjugatePosterior&>(posterior).*member_of(ConjugateCloud{}));
    case tiller_posterior_transition:
      if (is_bank(config)) return {};
      return rows_of(static_cast<const tiller::TransitionPosterior&>(posterior).transitions().cloud());
    default: return {};
  }
}

}  // namespace tiller::python
