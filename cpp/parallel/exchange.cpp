#include "parallel/exchange.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>

using namespace qsdolfinx;

namespace
{
constexpr int data_tag = 4200;

/// Tag for the next consensus on a communicator. Successive ones need different tags, because a
/// fast rank may already send for the next while a slow one still listens: the communicator itself
/// counts them, so that its ranks agree whatever they do on others.
int next_consensus_tag(MPI_Comm comm)
{
  static int key = MPI_KEYVAL_INVALID;
  if (key == MPI_KEYVAL_INVALID)
    MPI_Comm_create_keyval(
        MPI_COMM_NULL_COPY_FN,
        [](MPI_Comm, int, void* value, void*)
        {
          delete static_cast<int*>(value);
          return MPI_SUCCESS;
        },
        &key, nullptr);
  void* value = nullptr;
  int found = 0;
  MPI_Comm_get_attr(comm, key, &value, &found);
  if (!found)
  {
    value = new int(0);
    MPI_Comm_set_attr(comm, key, value);
  }
  auto& count = *static_cast<int*>(value);
  count = 1 - count;
  return data_tag + 1 + count;
}

/// Numbers of records that other ranks will send to this one: the non-blocking consensus algorithm
/// of Hoefler, Siebert and Lumsdaine (2010), which needs no array of the communicator's size.
std::map<int, int> discover_sources(MPI_Comm comm, const std::map<int, int>& counts_to)
{
  const int tag = next_consensus_tag(comm);
  std::vector<MPI_Request> sends(counts_to.size());
  std::size_t i = 0;
  for (const auto& [rank, count] : counts_to)
    MPI_Issend(&count, 1, MPI_INT, rank, tag, comm, &sends[i++]);

  std::map<int, int> counts_from;
  MPI_Request barrier = MPI_REQUEST_NULL;
  bool in_barrier = false;
  for (int done = 0; !done;)
  {
    int arrived = 0;
    MPI_Status status;
    MPI_Iprobe(MPI_ANY_SOURCE, tag, comm, &arrived, &status);
    if (arrived)
      MPI_Recv(&counts_from[status.MPI_SOURCE], 1, MPI_INT, status.MPI_SOURCE, tag, comm,
               MPI_STATUS_IGNORE);
    if (in_barrier)
      MPI_Test(&barrier, &done, MPI_STATUS_IGNORE);
    else
    {
      int all_sent = 0;
      MPI_Testall(static_cast<int>(sends.size()), sends.data(), &all_sent, MPI_STATUSES_IGNORE);
      if (all_sent)
      {
        MPI_Ibarrier(comm, &barrier);
        in_barrier = true;
      }
    }
  }
  return counts_from;
}
} // namespace

Exchange::Exchange(MPI_Comm comm, std::span<const int> dest) : comm_(comm), order_(dest.size())
{
  std::iota(order_.begin(), order_.end(), 0);
  std::stable_sort(order_.begin(), order_.end(), [&](auto a, auto b) { return dest[a] < dest[b]; });
  std::map<int, int> counts_to;
  for (int rank : dest)
    ++counts_to[rank];
  to_ = peers(counts_to);
  from_ = peers(discover_sources(comm, counts_to));
  for (const Peer& peer : from_)
    num_received_ += static_cast<std::size_t>(peer.count);
}

std::vector<Exchange::Peer> Exchange::peers(const std::map<int, int>& counts)
{
  std::vector<Peer> out;
  std::size_t offset = 0;
  for (const auto& [rank, count] : counts)
  {
    out.push_back({rank, count, offset});
    offset += static_cast<std::size_t>(count);
  }
  return out;
}

void Exchange::send(const void* in, const std::vector<Peer>& targets, void* out,
                    const std::vector<Peer>& sources, std::size_t record_bytes) const
{
  // One MPI element per record keeps counts within int for any record width.
  MPI_Datatype record;
  MPI_Type_contiguous(static_cast<int>(record_bytes), MPI_BYTE, &record);
  MPI_Type_commit(&record);
  std::vector<MPI_Request> requests(sources.size() + targets.size());
  std::size_t i = 0;
  for (const Peer& p : sources)
    MPI_Irecv(static_cast<char*>(out) + p.offset * record_bytes, p.count, record, p.rank, data_tag,
              comm_, &requests[i++]);
  for (const Peer& p : targets)
    MPI_Isend(static_cast<const char*>(in) + p.offset * record_bytes, p.count, record, p.rank,
              data_tag, comm_, &requests[i++]);
  MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE);
  MPI_Type_free(&record);
}

std::vector<double> qsdolfinx::all_bounding_boxes(MPI_Comm comm, std::span<const double> points)
{
  constexpr double inf = std::numeric_limits<double>::infinity();
  std::array<double, 6> box{inf, inf, inf, -inf, -inf, -inf};
  for (std::size_t i = 0; i < points.size(); i += 3)
  {
    for (std::size_t j = 0; j < 3; ++j)
    {
      box[j] = std::min(box[j], points[i + j]);
      box[3 + j] = std::max(box[3 + j], points[i + j]);
    }
  }
  int size;
  MPI_Comm_size(comm, &size);
  std::vector<double> boxes(static_cast<std::size_t>(size) * 6);
  MPI_Allgather(box.data(), 6, MPI_DOUBLE, boxes.data(), 6, MPI_DOUBLE, comm);
  return boxes;
}
