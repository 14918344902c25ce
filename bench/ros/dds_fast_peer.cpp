/* dds_fast_peer.cpp: a peer on Fast DDS, whose types fastddsgen made of the package's IDL.
 *
 * Purpose: sends the k-th sample on one topic, waits for the answer with k on another and checks
 * every field of it; or sends bytes that are no such sample. Non-goals: counting for others.
 *
 * Words: KEY bridged|plain FROM COUNT SEND_TOPIC HEAR_TOPIC ANSWER_KEY   or   raw KEY TOPIC FILE
 */
#include "dds_fields_messagesPubSubTypes.h"
#include "dds_values.h"

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <thread>
#include <time.h>
#include <vector>

#include "fast_code.h"

using namespace eprosima::fastdds::dds;
typedef nav_msgs::msg::dds_::Odometry_ Odom;
typedef sensor_msgs::msg::dds_::LaserScan_ Scan;
typedef nav_msgs::msg::dds_::Odometry_PubSubType OdomType;
typedef sensor_msgs::msg::dds_::LaserScan_PubSubType ScanType;

static const eprosima::fastrtps::Duration_t SHORT = {0, 2000000};

static int64_t wall() {
  struct timespec t;
  (void)clock_gettime(CLOCK_REALTIME, &t);
  return int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}

template <class M>
static void stamp(M* m) {
  const int64_t now = wall();
  m->header_().stamp_().sec_(int32_t(now / 1000000000));
  m->header_().stamp_().nanosec_(uint32_t(now % 1000000000));
  m->header_().frame_id_("odom");
}

static void bridge(Odom* m, uint32_t k) {
  stamp(m);
  m->child_frame_id_(child_of(k));
}
static void bridge(Scan* m, uint32_t) { stamp(m); }

static void fill(Odom* m, uint32_t k) { fill_odom(*m, k); }
static void fill(Scan* m, uint32_t k) { fill_scan(*m, k); }
static const char* check(const Odom& m, uint32_t k, int b) { return check_odom(m, k, b); }
static const char* check(const Scan& m, uint32_t k, int b) { return check_scan(m, k, b); }
static uint32_t counter(const Odom& m) { return counter_odom(m); }
static uint32_t counter(const Scan& m) { return counter_scan(m); }
static bool taken(const Odom&) { return true; }
static bool taken(const Scan& m) { return m.ranges_().size() >= 8; }
template <class M>
static int64_t stamped(const M& m) {
  return int64_t(m.header_().stamp_().sec_()) * 1000000000 + m.header_().stamp_().nanosec_();
}

static DomainParticipant* participant() {
  DomainParticipantQos qos;
  qos.name("fast_peer");
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().user_transports.push_back(udp);
  return DomainParticipantFactory::get_instance()->create_participant(
      uint32_t(atoi(getenv("ROS_DOMAIN_ID"))), qos);
}

static DataWriter* writer(DomainParticipant* in, TypeSupport type, const char* topic) {
  type.register_type(in);
  DataWriterQos qos;
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = VOLATILE_DURABILITY_QOS;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 100;
  return in->create_publisher(PUBLISHER_QOS_DEFAULT)
      ->create_datawriter(in->create_topic(topic, type.get_type_name(), TOPIC_QOS_DEFAULT), qos);
}

static bool matched(DataWriter* w) {
  PublicationMatchedStatus status;
  for (int i = 0; i < 1000; i++) {
    w->get_publication_matched_status(status);
    if (status.current_count > 0) {
      return true;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

template <class M, class A>
static int exchange(TypeSupport sent, TypeSupport heard, bool bridged, uint32_t from, uint32_t count,
                    const char* to, const char* at) {
  DomainParticipant* const in = participant();
  DataWriter* const w = writer(in, sent, to);
  heard.register_type(in);
  DataReaderQos qos;
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.history().kind = KEEP_ALL_HISTORY_QOS;
  auto* topic = in->create_topic(at, heard.get_type_name(), TOPIC_QOS_DEFAULT);
  DataReader* const r = in->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, qos);
  if (!matched(w)) {
    (void)printf("{\"matched\":false}\n");
    return 1;
  }
  std::this_thread::sleep_for(std::chrono::seconds(1)); /* the other side has to know it, too */
  M m;
  A answer;
  SampleInfo info;
  unsigned long answered = 0, lost = 0, misread = 0, unasked = 0, passed = 0;
  int64_t off = 0;
  const char* first = "";
  bool warm = false;
  int tries = 0;
  for (uint32_t k = from; k < from + count; k++) {
    fill(&m, k);
    if (bridged) {
      bridge(&m, k);
    }
    const int64_t asked = stamped(m);
    w->write(&m);
    if (bridged && !taken(m)) {
      passed++;
      continue;
    }
    bool there = false;
    for (int64_t end = wall() + 3000000000; !there && wall() < end;) {
      if (!r->wait_for_unread_message(SHORT)) {
        continue;
      }
      while (!there && r->take_next_sample(&answer, &info) == ReturnCode_t::RETCODE_OK) {
        if (!info.valid_data) {
          continue;
        }
        const uint32_t got = counter(answer);
        const char* const wrong = check(answer, got, bridged);
        misread += wrong != NULL;
        first = wrong != NULL && first[0] == '\0' ? wrong : first;
        there = got == k;
        unasked += got != k;
        const int64_t d = stamped(answer) - asked;
        off = there && bridged && warm && llabs(d) > off ? llabs(d) : off;
      }
    }
    if (!there && !warm && tries++ < 20) {
      k--; /* the two do not know each other yet: the first one is sent again */
      continue;
    }
    warm = true;
    answered += there;
    lost += !there;
  }
  (void)printf("{\"matched\":true,\"sent\":%u,\"answered\":%lu,\"refused\":%lu,\"lost\":%lu,"
               "\"misread\":%lu,\"unasked\":%lu,\"first\":\"%s\",\"stamp_off_ns\":%lld}\n",
               count, answered, passed, lost, misread, unasked, first, (long long)off);
  w->wait_for_acknowledgments({5, 0});
  return 0;
}

/* A type of the right name that writes given bytes. */
class Raw : public TopicDataType {
 public:
  explicit Raw(const char* name) {
    setName(name);
    m_typeSize = 70000;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
    const auto& bytes = *static_cast<std::vector<unsigned char>*>(data);
    payload->length = uint32_t(bytes.size());
    (void)memcpy(payload->data, bytes.data(), bytes.size());
    return true;
  }
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t*, void*) override { return false; }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data]() { return uint32_t(static_cast<std::vector<unsigned char>*>(data)->size()); };
  }
  void* createData() override { return new std::vector<unsigned char>; }
  void deleteData(void* data) override { delete static_cast<std::vector<unsigned char>*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

/* FILE: payloads, each after its length as 4 bytes, the lowest first. */
static int raw(const char* type, const char* topic, const char* file) {
  DomainParticipant* const in = participant();
  DataWriter* const w = writer(in, TypeSupport(new Raw(type)), topic);
  const bool met = matched(w);
  std::this_thread::sleep_for(std::chrono::seconds(2)); /* both sides have to know it */
  std::ifstream given(file, std::ios::binary);
  const std::vector<unsigned char> all((std::istreambuf_iterator<char>(given)), {});
  unsigned long sent = 0;
  for (size_t at = 0; at + 4 <= all.size();) {
    const size_t n = all[at] | all[at + 1] << 8 | size_t(all[at + 2]) << 16;
    std::vector<unsigned char> bytes(all.begin() + long(at + 4), all.begin() + long(at + 4 + n));
    at += 4 + n;
    sent += w->write(&bytes);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  w->wait_for_acknowledgments({5, 0});
  (void)printf("{\"matched\":%s,\"sent\":%lu}\n", met ? "true" : "false", sent);
  return 0;
}

int main(int count, char** w) {
  if (count == 5 && strcmp(w[1], "raw") == 0) {
    return raw(w[2], w[3], w[4]);
  }
  if (count != 8) {
    return 2;
  }
  const bool bridged = strcmp(w[2], "bridged") == 0;
  const uint32_t from = uint32_t(atol(w[3])), many = uint32_t(atol(w[4]));
  TypeSupport odom(new OdomType), scan(new ScanType);
  if (strcmp(w[1], "odom") == 0) {
    return exchange<Odom, Odom>(odom, odom, bridged, from, many, w[5], w[6]);
  }
  return strcmp(w[7], "odom") == 0
             ? exchange<Scan, Odom>(scan, odom, bridged, from, many, w[5], w[6])
             : exchange<Scan, Scan>(scan, scan, bridged, from, many, w[5], w[6]);
}
