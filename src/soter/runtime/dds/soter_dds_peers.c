/* soter_dds_peers.c: what DDS knows of everybody else's readers and writers.
 *
 * Purpose: which writer may be heard; and that what does not match is said: types, QoS, a second
 * writer of what only the bridge may write. Nothing here decides whether a sample is new.
 * Non-goals: samples (soter_dds_samples.c); keeping out whoever lies about a name: DDS without its
 * security does not.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_dds_topics.h"

#include <stdio.h>
#include <string.h>

#define AT_ONCE 32

const char* soter_dds_open_peers(soter_dds_bridge* bridge) {
  SOTER_CHECK(bridge->participant > 0);
  const dds_entity_t in = bridge->participant;
  bridge->participants = dds_create_reader(in, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, NULL, NULL);
  bridge->writers = dds_create_reader(in, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, NULL, NULL);
  bridge->readers = dds_create_reader(in, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, NULL, NULL);
  return bridge->participants < 0 || bridge->writers < 0 || bridge->readers < 0
             ? "DDS does not say who is there"
             : NULL;
}

/* ------------------------------------------------------------------ who writes */

static void name_of(const dds_qos_t* qos, char* name) {
  SOTER_CHECK(name != NULL);
  char* given = NULL;
  name[0] = '\0';
  if (qos != NULL && dds_qget_entity_name(qos, &given) && given != NULL) {
    (void)snprintf(name, SOTER_DDS_NAME, "%s", given);
    dds_free(given);
  }
}

static void name_of_participant(const soter_dds_bridge* bridge, dds_instance_handle_t handle,
                                char* name) {
  SOTER_CHECK(bridge->participants > 0 && name != NULL);
  void* sample[1] = {NULL};
  dds_sample_info_t info[1];
  name[0] = '\0';
  const dds_return_t many = dds_read_instance(bridge->participants, sample, info, 1, 1, handle);
  if (many > 0) {
    const dds_builtintopic_participant_t* const found = sample[0];
    if (info[0].valid_data) {
      name_of(found->qos, name);
    }
    (void)dds_return_loan(bridge->participants, sample, many);
  }
}

/* Whether DDS still matches a writer; its name, or that of its participant, and its GUID. */
static bool writer_of(const soter_dds_topic* topic, dds_instance_handle_t writer, char* name,
                      char* shown) {
  SOTER_CHECK(topic->in != NULL && name != shown);
  dds_builtintopic_endpoint_t* const found = dds_get_matched_publication_data(topic->end, writer);
  char guid[2 * sizeof found->key.v + 1];
  name[0] = shown[0] = '\0';
  if (found == NULL) {
    return false;
  }
  name_of(found->qos, name);
  if (name[0] == '\0') {
    name_of_participant(topic->bridge, found->participant_instance_handle, name);
  }
  for (size_t i = 0; i < sizeof found->key.v; i++) {
    (void)snprintf(guid + 2 * i, 3, "%02x", found->key.v[i]);
  }
  (void)snprintf(shown, SOTER_DDS_NAME, "%.80s%s%s", name, name[0] != '\0' ? " " : "", guid);
  dds_builtintopic_free_endpoint(found);
  return true;
}

static void bind_to(soter_dds_topic* topic, dds_instance_handle_t writer, const char* shown) {
  SOTER_CHECK(topic->in != NULL && shown != NULL);
  topic->bound = writer;
  (void)pthread_mutex_lock(&topic->held);
  topic->count[SOTER_DDS_BOUND]++;
  (void)snprintf(topic->publisher, sizeof topic->publisher, "%s", shown);
  (void)pthread_mutex_unlock(&topic->held);
}

bool soter_dds_may_write(soter_dds_topic* topic, dds_instance_handle_t writer) {
  SOTER_CHECK(topic->in != NULL);
  char name[SOTER_DDS_NAME], shown[SOTER_DDS_NAME], why[SOTER_DDS_WHY];
  if (writer == topic->bound) {
    return true;
  }
  const bool named = topic->in->publisher[0] != '\0';
  if (!named || writer != topic->refused) {
    const bool there = writer_of(topic, writer, name, shown);
    bool may = named && there && strcmp(name, topic->in->publisher) == 0;
    if (!named) { /* it is bound to the first one for as long as DDS knows that one */
      char of_bound[SOTER_DDS_NAME], guid_of_bound[SOTER_DDS_NAME];
      may = topic->bound == DDS_HANDLE_NIL ||
            !writer_of(topic, topic->bound, of_bound, guid_of_bound);
    }
    if (may) {
      bind_to(topic, writer, there ? shown : "a writer that is gone");
      return true;
    }
    topic->refused = writer;
    (void)snprintf(why, sizeof why, "a second writer: %s", there ? shown : "one that is gone");
    soter_dds_count(topic, SOTER_DDS_STRANGER, why);
    return false;
  }
  soter_dds_count(topic, SOTER_DDS_STRANGER, "a second writer");
  return false;
}

/* ------------------------------------------------------------------ what does not match */

static const char* policy(uint32_t id) {
  switch (id) {
    case DDS_RELIABILITY_QOS_POLICY_ID:
      return "reliability";
    case DDS_DURABILITY_QOS_POLICY_ID:
      return "durability";
    case DDS_DEADLINE_QOS_POLICY_ID:
      return "deadline";
    case DDS_LIVELINESS_QOS_POLICY_ID:
      return "liveliness";
    case DDS_OWNERSHIP_QOS_POLICY_ID:
      return "ownership";
    case DDS_PARTITION_QOS_POLICY_ID:
      return "partition";
    case DDS_DATA_REPRESENTATION_QOS_POLICY_ID:
      return "data representation";
    default:
      return "another policy";
  }
}

static void not_matched(soter_dds_topic* topic, uint32_t id, const char* peer) {
  char why[SOTER_DDS_WHY];
  if (id == DDS_TYPE_CONSISTENCY_ENFORCEMENT_QOS_POLICY_ID) {
    (void)snprintf(why, sizeof why, "a %s has a type of the same name, %s, that is another", peer,
                   topic->type);
    soter_dds_count(topic, SOTER_DDS_TYPE, why);
    return;
  }
  (void)snprintf(why, sizeof why, "the QoS of a %s does not match: %s (`qos` of the mapping)", peer,
                 policy(id));
  soter_dds_count(topic, SOTER_DDS_QOS, why);
}

static void look_at_qos(soter_dds_topic* topic) {
  SOTER_CHECK((topic->in != NULL) != (topic->out != NULL));
  if (topic->in != NULL) {
    dds_requested_incompatible_qos_status_t status;
    if (dds_get_requested_incompatible_qos_status(topic->end, &status) == DDS_RETCODE_OK &&
        status.total_count_change > 0) {
      not_matched(topic, status.last_policy_id, "writer");
    }
  } else {
    dds_offered_incompatible_qos_status_t status;
    if (dds_get_offered_incompatible_qos_status(topic->end, &status) == DDS_RETCODE_OK &&
        status.total_count_change > 0) {
      not_matched(topic, status.last_policy_id, "reader");
    }
  }
}

static void meet(soter_dds_topic* topic, const dds_builtintopic_endpoint_t* peer, bool writes) {
  SOTER_CHECK(topic->topic != NULL && topic->type != NULL);
  char why[SOTER_DDS_WHY];
  if (strcmp(peer->topic_name, topic->topic) != 0) {
    return;
  }
  if (strcmp(peer->type_name, topic->type) != 0) {
    (void)snprintf(why, sizeof why, "a %s has another type: %.80s, not %.80s",
                   writes ? "writer" : "reader", peer->type_name, topic->type);
    soter_dds_count(topic, SOTER_DDS_TYPE, why);
  } else if (writes && topic->out != NULL) {
    soter_dds_count(topic, SOTER_DDS_OTHERS,
                    "somebody else writes it, too, which nobody can keep from it");
  }
}

static void look_at_endpoints(soter_dds_bridge* bridge, dds_entity_t reader, bool writes) {
  void* sample[AT_ONCE] = {NULL};
  dds_sample_info_t info[AT_ONCE];
  dds_guid_t own;
  if (dds_get_guid(bridge->participant, &own) < 0) {
    return;
  }
  dds_return_t many = 0;
  while ((many = dds_take(reader, sample, info, AT_ONCE, AT_ONCE)) > 0) {
    SOTER_CHECK(many <= AT_ONCE);
    for (int32_t i = 0; i < many; i++) {
      const dds_builtintopic_endpoint_t* const peer = sample[i];
      if (!info[i].valid_data || info[i].instance_state != DDS_IST_ALIVE ||
          memcmp(&peer->participant_key, &own, sizeof own) == 0) {
        continue;
      }
      for (size_t k = 0; k < bridge->topics; k++) {
        meet(&bridge->topic[k], peer, writes);
      }
    }
    (void)dds_return_loan(reader, sample, many);
  }
}

void soter_dds_look(soter_dds_bridge* bridge) {
  SOTER_CHECK(bridge->topic != NULL);
  look_at_endpoints(bridge, bridge->writers, true);
  look_at_endpoints(bridge, bridge->readers, false);
  for (size_t k = 0; k < bridge->topics; k++) {
    look_at_qos(&bridge->topic[k]);
  }
}
