// What `ip -details -statistics -json link show` prints for controllers, in the shapes of iproute2 5 and 6 (mcp251xfd
// and gs_usb as they stand on robots), and what is to be said about them.
#include "tools/doctor/can_doctor.hpp"

#include <gtest/gtest.h>

#include <string>

namespace tiller::tools {
namespace {

/// iproute2 6: sample points as text.
const char* const kHealthy = R"([{"ifindex":3,"ifname":"can0","flags":["NOARP","UP","LOWER_UP","ECHO"],"mtu":72,
"qdisc":"pfifo_fast","operstate":"UP","linkmode":"DEFAULT","group":"default","txqlen":64,"link_type":"can",
"promiscuity":0,"linkinfo":{"info_kind":"can","info_data":{"ctrlmode":["FD"],"state":"ERROR-ACTIVE",
"berr_counter":{"tx":0,"rx":0},"restart_ms":100,"bittiming":{"bitrate":1000000,"sample_point":"0.800","tq":25,
"prop_seg":15,"phase_seg1":16,"phase_seg2":8,"sjw":1,"brp":1},"bittiming_const":{"name":"mcp251xfd",
"tseg1":{"min":2,"max":256},"tseg2":{"min":1,"max":128},"sjw":{"min":1,"max":128},"brp":{"min":1,"max":256},
"brp_inc":1},"data_bittiming":{"bitrate":5000000,"sample_point":"0.750","tq":25,"prop_seg":2,"phase_seg1":3,
"phase_seg2":2,"sjw":1,"brp":1},"clock":40000000},"info_xstats":{"restarts":0,"bus_error":0,"arbitration_lost":0,
"error_warning":0,"error_passive":0,"bus_off":0}},"num_tx_queues":1,"num_rx_queues":1,
"stats64":{"rx":{"bytes":80000,"packets":10000,"errors":0,"dropped":0,"over_errors":0,"multicast":0},
"tx":{"bytes":8000,"packets":1000,"errors":0,"dropped":0,"carrier_errors":0,"collisions":0}}}])";

/// iproute2 5: numbers; everything wrong that can be at once.
const char* const kSick = R"([{"ifindex":4,"ifname":"can1","flags":["NO-CARRIER","NOARP","UP","ECHO"],"mtu":16,
"qdisc":"pfifo_fast","operstate":"DOWN","txqlen":10,"link_type":"can","linkinfo":{"info_kind":"can","info_data":{
"ctrlmode":["LOOPBACK","LISTEN-ONLY","ONE-SHOT","PRESUME-ACK"],"state":"BUS-OFF","berr_counter":{"tx":248,"rx":0},
"restart_ms":0,"bittiming":{"bitrate":500000,"sample_point":0.500,"tq":125,"prop_seg":6,"phase_seg1":7,
"phase_seg2":2,"sjw":1},"clock":48000000},"info_xstats":{"restarts":2,"bus_error":17,"arbitration_lost":0,
"error_warning":3,"error_passive":3,"bus_off":2}},"stats64":{"rx":{"bytes":0,"packets":0,"errors":20,"dropped":5,
"over_errors":7},"tx":{"bytes":0,"packets":0,"errors":0,"dropped":9}}}])";

const char* const kDown = R"([{"ifname":"can0","flags":["NOARP","ECHO"],"mtu":16,"qdisc":"noop","operstate":"DOWN",
"txqlen":10,"link_type":"can","linkinfo":{"info_kind":"can","info_data":{"state":"STOPPED","restart_ms":0,
"clock":8000000}},"stats64":{"rx":{},"tx":{}}}])";

const char* const kVirtual = R"([{"ifname":"vcan0","flags":["NOARP","UP","LOWER_UP"],"mtu":16,"qdisc":"noqueue",
"operstate":"UNKNOWN","txqlen":1000,"link_type":"can","linkinfo":{"info_kind":"vcan"},
"stats64":{"rx":{"bytes":0,"packets":0},"tx":{"bytes":0,"packets":0}}}])";

CanLinkState link_of(const std::string& json) {
  CanLinkState link;
  std::string error;
  EXPECT_TRUE(parse_can_link(json, link, error)) << error;
  return link;
}

std::string text_of(const std::string& json, const CanDemand& demand = {}) {
  return can_findings_text(examine_can_link(link_of(json), demand));
}

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST(CanDoctor, AHealthyInterfaceHasNothingToMend) {
  const CanLinkState link = link_of(kHealthy);
  EXPECT_EQ("can", link.kind);
  EXPECT_EQ(1000000, link.bitrate);
  EXPECT_EQ(5000000, link.data_bitrate);
  EXPECT_DOUBLE_EQ(0.8, link.sample_point);
  EXPECT_EQ(100, link.restart_ms);
  EXPECT_EQ(11000, link.frames);
  CanDemand demand;
  demand.fd = true;
  demand.frames_per_tick = 13;
  const auto findings = examine_can_link(link, demand);
  EXPECT_EQ(Severity::good, worst(findings)) << can_findings_text(findings);
  EXPECT_FALSE(has(can_findings_text(findings), "->"));
}

TEST(CanDoctor, EveryAilmentHasItsCommand) {
  CanDemand demand;
  demand.fd = true;
  const std::string text = text_of(kSick, demand);
  EXPECT_EQ(Severity::failure, worst(examine_can_link(link_of(kSick), demand)));
  for (const char* part :
       {"is bus-off", "sudo ip link set can1 type can restart", "sample point 0.5", "sample-point 0.875",
        "restart-ms 100", "listen-only off", "loopback off", "one-shot off", "presume-ack off", "no CAN FD",
        "dbitrate 5000000 fd on", "send queue of 10 frames", "txqueuelen 64", "bus-off 2 times", "17 bus errors",
        "7 frames were lost", "5 frames were dropped", "9 frames were dropped", "248 sending"})
    EXPECT_TRUE(has(text, part)) << part << "\n" << text;
}

TEST(CanDoctor, AnInterfaceThatWasNeverSetUp) {
  const std::string text = text_of(kDown);
  EXPECT_TRUE(has(text, "FAIL  it is down")) << text;
  EXPECT_TRUE(has(text, "sudo ip link set can0 up type can bitrate 500000 restart-ms 100")) << text;
  EXPECT_TRUE(has(text, "no bit rate is set")) << text;
}

TEST(CanDoctor, AVirtualOneHasNoControllerAndCanBeMadeFd) {
  EXPECT_EQ(Severity::good, worst(examine_can_link(link_of(kVirtual), {}))) << text_of(kVirtual);
  CanDemand fd;
  fd.fd = true;
  EXPECT_TRUE(has(text_of(kVirtual, fd), "sudo ip link set vcan0 mtu 72 up"));
}

TEST(CanDoctor, StatesOneByOne) {
  const auto with_state = [](const std::string& state) {
    std::string json = kHealthy;
    const std::string from = "ERROR-ACTIVE";
    json.replace(json.find(from), from.size(), state);
    return worst(examine_can_link(link_of(json), {}));
  };
  EXPECT_EQ(Severity::good, with_state("ERROR-ACTIVE"));
  EXPECT_EQ(Severity::warning, with_state("ERROR-WARNING"));
  EXPECT_EQ(Severity::failure, with_state("ERROR-PASSIVE"));
  EXPECT_EQ(Severity::failure, with_state("BUS-OFF"));
  EXPECT_EQ(Severity::warning, with_state("SLEEPING"));
}

TEST(CanDoctor, QueuesTooShortAndTooLong) {
  const auto with_queue = [](const std::string& length, std::int64_t frames) {
    std::string json = kHealthy;
    const std::string from = "\"txqlen\":64";
    json.replace(json.find(from), from.size(), "\"txqlen\":" + length);
    CanDemand demand;
    demand.frames_per_tick = frames;
    return text_of(json, demand);
  };
  EXPECT_FALSE(has(with_queue("64", 13), "WARN"));
  EXPECT_TRUE(has(with_queue("10", 0), "txqueuelen 64"));
  EXPECT_TRUE(has(with_queue("20", 13), "txqueuelen 64"));
  EXPECT_TRUE(has(with_queue("65536", 13), "old commands"));
}

// 1000 frames of 8 bytes a second at 500 kbit/s: 111 bits each, a tenth for stuffing: 24.4 %
TEST(CanDoctor, Load) {
  CanLinkState before, after;
  before.bitrate = after.bitrate = 500000;
  after.frames = 1000;
  after.bytes = 8000;
  EXPECT_NEAR(0.2442, can_load(before, after, 1.0), 1e-4);
  EXPECT_EQ(Severity::good, examine_can_load(0.24).severity);
  EXPECT_EQ(Severity::warning, examine_can_load(0.6).severity);
  EXPECT_EQ(Severity::failure, examine_can_load(0.9).severity);
  before.bitrate = -1;
  EXPECT_LT(can_load(before, after, 1.0), 0);
}

TEST(CanDoctor, ListenersOfOneInterface) {
  CanListeners listeners;
  count_can_listeners("rcvlist_all",
                      "\nreceive list 'rx_all':\n  device   can_id   can_mask  function  userdata   matches  ident\n"
                      "   vcan0     000    00000000  00000000  00000000         4  raw\n"
                      "   vcan1     000    00000000  00000000  00000000         0  raw\n",
                      "vcan0", listeners);
  count_can_listeners("rcvlist_sff", "  vcan0  061  c00007ff 0 0 1 raw\n  vcan0  069  c00007ff 0 0 1 raw\n", "vcan0",
                      listeners);
  count_can_listeners("rcvlist_err", "  vcan0  000  1fffffff 0 0 1 raw\n", "vcan0", listeners);
  EXPECT_EQ(1, listeners.everything);
  EXPECT_EQ(2, listeners.filters);
  EXPECT_EQ(1, listeners.errors);
  EXPECT_TRUE(has(describe_can_listeners(listeners).what, "2 filters"));
}

TEST(CanDoctor, WhatIsNoDescriptionIsRefusedAndWhatIsNoBusIsNamed) {
  CanLinkState link;
  std::string error;
  for (const char* text : {"", "{}", "[]", "[1]", "[{}]", "[{\"ifname\":7}]", "nonsense"})
    EXPECT_FALSE(parse_can_link(text, link, error)) << text;
  const char* const loopback = R"([{"ifname":"lo","flags":["UP"],"mtu":65536,"txqlen":1000}])";
  EXPECT_TRUE(has(text_of(loopback), "lo is not a CAN interface"));
  // wrong types where numbers stand are numbers that nobody told
  const char* const odd = R"([{"ifname":"can0","flags":"UP","mtu":"x","linkinfo":{"info_kind":"can","info_data":[]}}])";
  EXPECT_TRUE(has(text_of(odd), "it is down"));
}

TEST(CanDoctor, AsJson) {
  const auto findings = examine_can_link(link_of(kSick), {});
  const std::string json = can_findings_json("can1", findings);
  EXPECT_TRUE(has(json, "\"worst\": \"failure\"")) << json;
  EXPECT_TRUE(has(json, "\"interface\": \"can1\""));
}

}  // namespace
}  // namespace tiller::tools
