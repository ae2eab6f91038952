"""Records what Ultralytics answers: made peer_answers.json, in an environment of its own that has Ultralytics 8.4.190.

    python record_peer.py n=11n.pt v8n=v8n.pt v8n-p6=v8n-p6.pt > peer_answers.json

That program itself writes the files there, ``YOLO("copy.yaml", task="pose").save("11n.pt")`` with ``nc: 1`` and
``kpt_shape: [7, 3]`` in a copy of its yolo11n-pose.yaml, and so on. Their weights do not matter, since
:func:`filling.fill` overwrites them. Runs in float64, so that whatever differs is ours.
"""

import hashlib
import json
import sys

import torch
from filling import fill, picture

HEIGHT, WIDTH = 128, 192
ANCHORS = 16


def main() -> None:
    """Print the answers of all models on the command line."""
    recorded = {}
    for argument in sys.argv[1:]:
        variant, path = argument.split("=")
        model = torch.load(path, map_location="cpu", weights_only=False)["model"].double().eval()
        state = model.state_dict()
        model.load_state_dict({name: torch.from_numpy(fill(name, tuple(t.shape))) for name, t in state.items()})
        names = "".join(f"{name} {list(tensor.shape)}\n" for name, tensor in sorted(state.items()))
        with torch.inference_mode():
            answer = model(torch.from_numpy(picture(HEIGHT, WIDTH)).double())[0][0].T  # (A, 4 + 1 + 21)
        chosen = torch.linspace(0, len(answer) - 1, ANCHORS).long()
        recorded[variant] = {
            "parameters": sum(p.numel() for p in model.parameters()),
            "names_sha256": hashlib.sha256(names.encode()).hexdigest(),
            "anchors": chosen.tolist(),
            "cx_cy_w_h_score_keypoints": [[round(x, 6) for x in row] for row in answer[chosen].tolist()],
        }
    print(json.dumps({"height_px": HEIGHT, "width_px": WIDTH, "answers": recorded}))


if __name__ == "__main__":
    main()
