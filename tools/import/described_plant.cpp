#include "tools/import/described_plant.hpp"

#include <algorithm>

#include "tools/import/model_writer.hpp"

namespace tiller::tools {
namespace {

sim::Rotation3 plain(const Mat3<double>& m) {
  sim::Rotation3 out{};
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out[static_cast<std::size_t>(3 * r + c)] = m(r, c);
  return out;
}

/// From the links and joints of the file alone; the mechanism lends its names and its order, nothing of its numbers but
/// what it was told of armatures.
class TreeBuilder {
 public:
  TreeBuilder(const Description& robot, const Mechanism& mechanism, const DescribedPlant& plant,
              std::vector<std::string>& errors)
      : robot_(robot), mechanism_(mechanism), plant_(plant), errors_(errors), names_(name_model(mechanism)) {}

  std::shared_ptr<const sim::Tree> build() {
    tree_->name = robot_.name;
    for (const LinkText& link : robot_.links) {
      sim::TreeLink out{link.name, link.body.mass_kg, link.body.com_m, plain(link.body.inertia_kgm2), ""};
      if (out.mass_kg > 0) out.mass_parameter = identifier(link.name) + "_mass_kg";
      tree_->links.push_back(out);
    }
    if (!plant_.frame.empty()) {
      tree_->payload_link = link_of(plant_.frame);
      for (const FrameText& point : robot_.frames)
        if (tree_->payload_link < 0 && point.name == plant_.frame) {
          tree_->payload_link = link_of(point.link);
          tree_->payload_m = point.pose.position;
        }
      if (tree_->payload_link < 0) fail(robot_.path + ": has no link '" + plant_.frame + "' to carry the payload");
    }
    reached_.assign(tree_->links.size(), false);
    for (std::size_t l = 0; l < reached_.size(); ++l)
      reached_[l] = std::none_of(robot_.joints.begin(), robot_.joints.end(),
                                 [&](const JointText& j) { return j.child == tree_->links[l].name; });
    add_fixed();
    for (std::size_t i = 0; i < mechanism_.bodies.size() && errors_.empty(); ++i) {
      add_moving(mechanism_.bodies[i], i);
      add_fixed();
    }
    std::string why;
    if (errors_.empty() && !sim::tree_is_possible(*tree_, why)) fail(robot_.path + ": " + why);
    return errors_.empty() ? tree_ : nullptr;
  }

 private:
  void fail(const std::string& text) {
    errors_.push_back(text + "; plant = \"model\" steps the controller's own model instead");
  }
  int link_of(const std::string& name) const {
    for (std::size_t l = 0; l < robot_.links.size(); ++l)
      if (robot_.links[l].name == name) return static_cast<int>(l);
    return -1;
  }
  bool moves(const JointText& joint) const {
    return std::any_of(mechanism_.bodies.begin(), mechanism_.bodies.end(),
                       [&](const MovingBody& b) { return b.joint == joint.name; });
  }

  /// Joints that do not move and whose parents are there, until there is none left.
  void add_fixed() {
    for (bool more = true; more;) {
      more = false;
      for (const JointText& joint : robot_.joints) {
        const auto parent = static_cast<std::size_t>(link_of(joint.parent));
        const auto child = static_cast<std::size_t>(link_of(joint.child));
        if (reached_[child] || !reached_[parent] || moves(joint)) continue;
        sim::TreeJoint out = common(joint);
        const auto held = plant_.hold.find(joint.name);
        if (joint.kind != JointKind::fixed && held != plant_.hold.end()) stand(joint, held->second, out);
        tree_->joints.push_back(out);
        reached_[child] = more = true;
      }
    }
  }

  sim::TreeJoint common(const JointText& joint) const {
    sim::TreeJoint out;
    out.name = joint.name;
    out.parent = link_of(joint.parent);
    out.child = link_of(joint.child);
    out.origin_m = joint.origin.position;
    out.rotation = plain(joint.origin.rotation);
    out.axis = joint.axis;
    return out;
  }

  /// A joint that is held stands where it is held.
  static void stand(const JointText& joint, double position, sim::TreeJoint& out) {
    Pose moved;
    if (joint.kind == JointKind::prismatic)
      moved.position = scaled(position, joint.axis);
    else
      moved.rotation = rotation_about(joint.axis, position);
    const Pose pose = joint.origin * moved;
    out.origin_m = pose.position;
    out.rotation = plain(pose.rotation);
  }

  void add_moving(const MovingBody& body, std::size_t index) {
    const auto joint = std::find_if(robot_.joints.begin(), robot_.joints.end(),
                                    [&](const JointText& j) { return j.name == body.joint; });
    if (joint == robot_.joints.end() || body.mimics >= 0)
      return fail(robot_.path + ": joint '" + body.joint + "' " +
                  (body.mimics >= 0 ? "follows another" : "is none of the description's") +
                  ", which the ODE plant does not have");
    const auto free = std::find(names_.bodies.begin(), names_.bodies.end(), static_cast<int>(index));
    const auto place = static_cast<std::size_t>(free - names_.bodies.begin());
    sim::TreeJoint out = common(*joint);
    out.kind = body.prismatic ? sim::TreeJoint::Kind::prismatic : sim::TreeJoint::Kind::revolute;
    out.name = names_.joints[place];
    out.position = names_.positions[place];
    out.rate = names_.velocities[place];
    out.driven = body.actuated;
    out.command = names_.forces[place];
    out.gain_parameter = identifier(joint->name) + "_gain";
    out.low = joint->low;
    out.high = joint->high;
    out.armature = body.armature;
    tree_->joints.push_back(out);
    reached_[static_cast<std::size_t>(out.child)] = true;
  }

  const Description& robot_;
  const Mechanism& mechanism_;
  const DescribedPlant& plant_;
  std::vector<std::string>& errors_;
  const ModelNames names_;
  std::shared_ptr<sim::Tree> tree_ = std::make_shared<sim::Tree>();
  std::vector<bool> reached_;  // (links)
};

}  // namespace

std::shared_ptr<const sim::Tree> describe_plant(const DescribedPlant& plant, std::vector<std::string>& errors) {
  Description robot;
  Mechanism mechanism;
  MechanismOptions options;
  options.any_inertia = true;  // the import has judged them
  for (const auto& [joint, position] : plant.hold) options.held.push_back({joint, position});
  for (const auto& [joint, inertia] : plant.armature) options.armature.push_back({joint, inertia});
  if (!read_description(plant.file, robot, errors) || !build_mechanism(robot, options, mechanism, errors))
    return nullptr;
  return TreeBuilder(robot, mechanism, plant, errors).build();
}

}  // namespace tiller::tools
