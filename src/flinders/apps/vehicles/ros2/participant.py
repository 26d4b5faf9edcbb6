"""A participant of a ROS 2 domain: lists its topics, reads them and writes them.

Qualities of service are those of rmw_cyclonedds for the profiles of ROS 2 (``create_readwrite_qos``). Readers request
best effort, as `SensorDataQoS` does, which matches every publisher; writers offer reliable.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Final

from flinders.apps.vehicles.ros2.names import DOMAIN, dds_topic, ros_topic, ros_type
from flinders.errors import LinkError
from flinders.foreign_errors import import_optional

if TYPE_CHECKING:
    from uuid import UUID

    from cyclonedds.builtin import DcpsEndpoint
    from cyclonedds.idl import IdlStruct
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader

EXTRA: Final = "ros2"
DISCOVERY_S: Final = 5.0  # Longest search for a publisher
LOOK_S: Final = 0.02
MAX_WAITING: Final = 20_000
"""Largest number of readings in the queue of a reader; older ones are dropped."""
MAX_TAKEN: Final = 5000
"""Largest number of samples in one call of a reader."""
MAX_OUTGOING: Final = 10  # Samples that a writer keeps for a slow reader, as in the default profile of ROS 2
ALIVE: Final = 16
"""``DDS_IST_ALIVE``: state of an instance that was not disposed of."""
BLOCKING_NS: Final = 100_000_000
NETWORK: Final = "CYCLONEDDS_URI"


class Participant:
    """A participant of a domain.

    Parameters
    ----------
    domain : int
        Number as in ``ROS_DOMAIN_ID``.

    Raises
    ------
    MissingExtra
        If Cyclone DDS's Python package is not installed.
    LinkError
        If DDS cannot use the network; DDS itself prints the reason to standard error.
    """

    def __init__(self, domain: int) -> None:
        self.domain = domain
        dds = import_optional("cyclonedds.domain", EXTRA, "a ROS 2 topic")
        builtin, core = (
            import_optional("cyclonedds.builtin", EXTRA, "a ROS 2 topic"),
            import_optional("cyclonedds.core", EXTRA, "it"),
        )
        try:
            self._entity = dds.DomainParticipant(domain)
            self._found = builtin.BuiltinDataReader(self._entity, builtin.BuiltinTopicDcpsPublication)
        except core.DDSException as error:
            raise LinkError(
                f"DDS cannot use the network for domain {domain} ({error.msg or error}): see that an interface is up, "
                f"and that {NETWORK}, where it is set, is a configuration of Cyclone DDS that names one"
            ) from None
        self._publications: dict[UUID, tuple[str, str]] = {}

    def published_types(self) -> dict[str, set[str]]:
        """Types of each topic that has a publisher, by its name in ROS 2."""
        endpoints: list[DcpsEndpoint] = self._found.take(MAX_TAKEN)
        for endpoint in endpoints:
            info: Any = endpoint.sample_info  # type: ignore[attr-defined]  # set by the reader
            name = ros_topic(endpoint.topic_name or "")
            if info.instance_state != ALIVE:
                self._publications.pop(endpoint.key, None)
            elif name is not None:
                self._publications[endpoint.key] = name, ros_type(endpoint.type_name)
        topics: dict[str, set[str]] = {}
        for name, kind in self._publications.values():
            topics.setdefault(name, set()).add(kind)
        return topics

    def find(self, topic: str, kind: str) -> None:
        """Wait for a publisher of a topic with a type.

        Raises `LinkError` without one, or for another type; the message names topics of the wanted type.
        """
        end = time.monotonic() + DISCOVERY_S
        while kind not in (topics := self.published_types()).get(topic, ()):
            if time.monotonic() > end:
                raise LinkError(_not_found(topic, kind, topics, self.domain))
            time.sleep(LOOK_S)

    def reader(self, topic: str, message: type[IdlStruct]) -> DataReader[Any]:
        """Subscribe to a topic."""
        from cyclonedds.core import Policy
        from cyclonedds.qos import Qos
        from cyclonedds.sub import DataReader

        qos = Qos(*_plain(), Policy.Reliability.BestEffort, Policy.History.KeepLast(MAX_WAITING))
        return DataReader(self._entity, self._topic(topic, message), qos=qos)

    def writer(self, topic: str, message: type[IdlStruct], *, is_latched: bool = False) -> DataWriter[Any]:
        """Publish a topic; with `is_latched`, later subscribers receive its last sample."""
        from cyclonedds.core import Policy
        from cyclonedds.pub import DataWriter
        from cyclonedds.qos import Qos

        from flinders.apps.vehicles.ros2.messages import TYPE_HASHES

        kept = Policy.History.KeepLast(1 if is_latched else MAX_OUTGOING)
        policies = [
            *_plain(),
            Policy.Reliability.Reliable(BLOCKING_NS),
            kept,
            Policy.WriterDataLifecycle(autodispose=False),
            Policy.Userdata(f"typehash={TYPE_HASHES[message]};".encode()),
        ]
        if is_latched:
            policies += [Policy.Durability.TransientLocal, Policy.DurabilityService(0, kept, -1, -1, -1)]
        return DataWriter(self._entity, self._topic(topic, message), qos=Qos(*policies))

    def waitset(self, *readers: DataReader[Any]) -> Any:  # noqa: ANN401 - a WaitSet, whose `wait` takes nanoseconds
        """Return an object that waits for a sample of any reader."""
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet

        waiting = WaitSet(self._entity)
        for reader in readers:
            waiting.attach(ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any))
        return waiting

    def _topic(self, topic: str, message: type[IdlStruct]) -> Any:  # noqa: ANN401 - a Topic of the message
        from cyclonedds.topic import Topic

        return Topic(self._entity, dds_topic(topic), message)


def _plain() -> list[Any]:
    """Representation that ROS 2 uses: CDR version 1."""
    from cyclonedds.core import Policy

    return [Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)]


def _not_found(topic: str, kind: str, topics: dict[str, set[str]], domain: int) -> str:
    """Message for a missing topic: the topics found, and a remedy."""
    usable = sorted(name for name, kinds in topics.items() if kind in kinds)
    instead = f"name one of those with {kind}: {', '.join(usable)}" if usable else ""
    if topic in topics:
        is_of = f"{topic} is of {' and '.join(sorted(topics[topic]))}, and {kind} is needed"
        return f"{is_of}: {instead or f'no topic of domain {domain} has it; start the driver of the sensor'}"
    found = f"no publisher of {topic} in domain {domain} within {DISCOVERY_S:g} s"
    if usable:
        return f"{found}: {instead}"
    seen = f"{len(topics)} other topics are published, none with {kind}" if topics else "no topic at all is published"
    return (
        f"{found}, and {seen}: see that the driver runs on DDS with the same {DOMAIN}, and that both use a network "
        f"that carries multicast, or the same interface of one machine ({NETWORK})"
    )
