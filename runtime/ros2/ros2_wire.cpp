#include "ros2/ros2_wire.hpp"

#include <atomic>
#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include <dds/ddsrt/log.h>

#include "ros2_messages.h"

namespace tiller {
namespace {

constexpr Ros2TypeInfo kTypes[] = {
    {&sensor_msgs_msg_dds__JointState__desc, "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"},
    {&sensor_msgs_msg_dds__Imu__desc, "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"},
    {&nav_msgs_msg_dds__Odometry__desc, "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"},
    {&std_msgs_msg_dds__Float64MultiArray__desc,
     "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f"},
    {&geometry_msgs_msg_dds__PoseStamped__desc,
     "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"},
    {&trajectory_msgs_msg_dds__JointTrajectory__desc,
     "RIHS01_179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e"},
    {&diagnostic_msgs_msg_dds__DiagnosticArray__desc,
     "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"},
    {&rmw_dds_common_msg_dds__ParticipantEntitiesInfo__desc,
     "RIHS01_e725f4a506958c79f95dd693b965722c57b19cd18e7eff984f49561b93dc985d"},
};

// Longer samples are not put together: one of a thousand joints has 40 kB. CYCLONEDDS_URI, which comes last, may say
// otherwise.
constexpr char kLimits[] =
    "<CycloneDDS><Domain><Internal><MaxSampleSize>64 kB</MaxSampleSize></Internal></Domain></CycloneDDS>,";
constexpr char kLocalhost[] =
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces></General></Domain>"
    "</CycloneDDS>,";

/// Beyond 232 the ports of RTPS end. False: ROS_DOMAIN_ID is no such number.
bool read_domain_id(dds_domainid_t* id) {
  constexpr unsigned long kLast = 232;
  const char* text = std::getenv("ROS_DOMAIN_ID");
  *id = 0;
  if (text == nullptr || *text == '\0') return true;
  char* end = nullptr;
  const unsigned long number = std::strtoul(text, &end, 10);
  *id = static_cast<dds_domainid_t>(number);
  return *end == '\0' && number <= kLast;
}

std::atomic<std::uint64_t> undecodable{0};

void count_undecodable(void*, const dds_log_data_t* line) {
  if (std::strstr(line->message, "deserialization") != nullptr)
    undecodable.fetch_add(1, std::memory_order_relaxed);
  else
    std::fprintf(stderr, "Cyclone DDS: %s", line->message);
}

/// One for the whole process and as long as it lives: a second participant of the same domain joins it.
dds_return_t make_domain(dds_domainid_t id) {
  const char* localhost = std::getenv("ROS_LOCALHOST_ONLY");
  const char* user = std::getenv("CYCLONEDDS_URI");
  const bool local = localhost != nullptr && std::strcmp(localhost, "1") == 0;
  char config[8192];
  const int length = std::snprintf(config, sizeof config, "%s%s%s", kLimits, local ? kLocalhost : "", user ? user : "");
  if (length < 0 || static_cast<std::size_t>(length) >= sizeof config) return DDS_RETCODE_BAD_PARAMETER;
  dds_set_log_sink(count_undecodable, nullptr);
  const dds_entity_t domain = dds_create_domain(id, config);
  return domain == DDS_RETCODE_PRECONDITION_NOT_MET ? DDS_RETCODE_OK : domain;
}

using Gid = rmw_dds_common_msg_dds__Gid_;

Gid gid_of(dds_entity_t entity) {
  dds_guid_t guid{};
  Gid gid{};
  static_assert(sizeof gid.data == sizeof guid.v, "a gid is DDS's own");
  if (dds_get_guid(entity, &guid) == DDS_RETCODE_OK) std::memcpy(gid.data, guid.v, sizeof guid.v);
  return gid;
}

dds_qos_t* endpoint_qos(Ros2Type type, Ros2Qos kind) {
  dds_qos_t* qos = dds_create_qos();
  const bool reliable = kind == Ros2Qos::kReliable;
  dds_qset_reliability(qos, reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, reliable ? 10 : 5);
  dds_qset_durability(qos, DDS_DURABILITY_VOLATILE);
  char data[128];
  const int length = std::snprintf(data, sizeof data, "typehash=%s;", ros2_type(type).hash);
  dds_qset_userdata(qos, data, static_cast<std::size_t>(length));
  return qos;
}

dds_entity_t make_topic(dds_entity_t participant, Ros2Type type, const char* topic) {
  return dds_create_topic(participant, ros2_type(type).descriptor, topic, nullptr, nullptr);
}

/// The type of a publisher of this topic that announces another one. False: there is none.
bool find_foreign_type(dds_entity_t participant, const char* topic, const char* type, char* found, std::size_t size) {
  const dds_entity_t known = dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, nullptr, nullptr);
  constexpr std::uint32_t kMost = 256;
  void* samples[kMost] = {};
  dds_sample_info_t info[kMost];
  const dds_return_t count = dds_read(known, samples, info, kMost, kMost);
  bool foreign = false;
  for (int i = 0; i < count && !foreign; ++i) {
    const auto* endpoint = static_cast<const dds_builtintopic_endpoint_t*>(samples[i]);
    if (!info[i].valid_data || std::strcmp(endpoint->topic_name, topic) != 0) continue;
    foreign = std::strcmp(endpoint->type_name, type) != 0;
    if (foreign) std::snprintf(found, size, "%s", endpoint->type_name);
  }
  if (count > 0) (void)dds_return_loan(known, samples, count);
  (void)dds_delete(known);
  return foreign;
}

}  // namespace

const Ros2TypeInfo& ros2_type(Ros2Type type) { return kTypes[static_cast<std::size_t>(type)]; }

bool ros2_topic(const char* name, char (&topic)[kRos2Topic]) {
  if (*name == '/') ++name;
  bool begins = true;  // a part of the name: a letter or _ first
  for (const char* c = name; *c != '\0'; ++c) {
    const auto letter = static_cast<unsigned char>(*c);
    const bool slash = *c == '/';
    if (begins ? std::isalpha(letter) == 0 && *c != '_' : std::isalnum(letter) == 0 && *c != '_' && !slash)
      return false;
    begins = slash;
  }
  if (begins) return false;
  const int length = std::snprintf(topic, sizeof topic, "rt/%s", name);
  return length > 0 && static_cast<std::size_t>(length) < sizeof topic;
}

std::uint64_t ros2_undecodable() { return undecodable.load(std::memory_order_relaxed); }

dds_entity_t ros2_participant() {
  dds_domainid_t id;
  if (!read_domain_id(&id)) return DDS_RETCODE_BAD_PARAMETER;
  const dds_return_t made = make_domain(id);
  if (made < 0) return made;
  dds_qos_t* qos = dds_create_qos();
  constexpr char kEnclave[] = "enclave=/;";
  dds_qset_userdata(qos, kEnclave, sizeof kEnclave - 1);
  const dds_entity_t participant = dds_create_participant(id, qos, nullptr);
  dds_delete_qos(qos);
  return participant;
}

dds_entity_t ros2_reader(dds_entity_t participant, Ros2Type type, const char* topic, Ros2Qos kind,
                         const dds_listener_t* listener) {
  const dds_entity_t of = make_topic(participant, type, topic);
  if (of < 0) return of;
  dds_qos_t* qos = endpoint_qos(type, kind);
  const dds_entity_t reader = dds_create_reader(participant, of, qos, listener);
  dds_delete_qos(qos);
  return reader;
}

dds_entity_t ros2_writer(dds_entity_t participant, Ros2Type type, const char* topic) {
  const dds_entity_t of = make_topic(participant, type, topic);
  if (of < 0) return of;
  dds_qos_t* qos = endpoint_qos(type, Ros2Qos::kReliable);
  const dds_entity_t writer = dds_create_writer(participant, of, qos, nullptr);
  dds_delete_qos(qos);
  return writer;
}

dds_return_t ros2_announce(dds_entity_t participant, const Ros2Node& node) {
  constexpr std::size_t kMost = 8;
  if (node.reader_count > kMost || node.writer_count > kMost) return DDS_RETCODE_BAD_PARAMETER;
  const dds_entity_t topic = make_topic(participant, Ros2Type::kParticipantEntities, "ros_discovery_info");
  if (topic < 0) return topic;
  dds_qos_t* qos = endpoint_qos(Ros2Type::kParticipantEntities, Ros2Qos::kReliable);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  const dds_entity_t writer = dds_create_writer(participant, topic, qos, nullptr);
  dds_delete_qos(qos);
  if (writer < 0) return writer;
  Gid readers[kMost], writers[kMost];
  for (std::size_t i = 0; i < node.reader_count; ++i) readers[i] = gid_of(node.readers[i]);
  for (std::size_t i = 0; i < node.writer_count; ++i) writers[i] = gid_of(node.writers[i]);
  rmw_dds_common_msg_dds__NodeEntitiesInfo_ entities{};
  std::snprintf(entities.node_namespace, sizeof entities.node_namespace, "/");
  std::snprintf(entities.node_name, sizeof entities.node_name, "%s", node.name);
  entities.reader_gid_seq._buffer = readers;
  entities.reader_gid_seq._length = static_cast<std::uint32_t>(node.reader_count);
  entities.writer_gid_seq._buffer = writers;
  entities.writer_gid_seq._length = static_cast<std::uint32_t>(node.writer_count);
  rmw_dds_common_msg_dds__ParticipantEntitiesInfo_ message{};
  message.gid = gid_of(participant);
  message.node_entities_info_seq._buffer = &entities;
  message.node_entities_info_seq._length = 1;
  return dds_write(writer, &message);
}

void ros2_explain_silence(dds_entity_t participant, dds_entity_t reader, Ros2Type type, const char* topic, char* text,
                          std::size_t size) {
  const char* wanted = ros2_type(type).descriptor->m_typename;
  dds_subscription_matched_status_t matched{};
  dds_requested_incompatible_qos_status_t unlike{};
  (void)dds_get_subscription_matched_status(reader, &matched);
  (void)dds_get_requested_incompatible_qos_status(reader, &unlike);
  char other[128];
  if (matched.current_count > 0)
    std::snprintf(text, size, "%s has a publisher, which sends nothing", topic);
  else if (unlike.total_count > 0)
    std::snprintf(text, size, "a publisher of %s offers another QoS; lockstep needs a reliable one", topic);
  else if (find_foreign_type(participant, topic, wanted, other, sizeof other))
    std::snprintf(text, size, "a publisher of %s has the type %s, not %s", topic, other, wanted);
  else
    std::snprintf(text, size, "nobody publishes %s in this domain", topic);
}

}  // namespace tiller
