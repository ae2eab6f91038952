"""The atom of the network: what it computes in training does not depend on how."""

import torch
from torch.nn import functional

from usvnet.network.blocks import Conv


def test_a_pointwise_layer_trains_as_the_convolution_that_it_is():
    """torch.nn.functional.conv2d beside it: answer and both gradients; the weight's in the layout that DDP asks for."""
    torch.manual_seed(0)
    layer = Conv(6, 10).double().to(memory_format=torch.channels_last)
    x = torch.randn(2, 12, 5, 4, dtype=torch.float64).to(memory_format=torch.channels_last)
    halves = [x[:, 6:].detach().requires_grad_() for _ in range(2)]  # a chunk: not dense in memory
    weight = layer.conv.weight.detach().clone().requires_grad_()
    expected = layer.act(layer.norm(functional.conv2d(halves[0], weight)))
    found = layer(halves[1])
    torch.testing.assert_close(found, expected)
    slope = torch.randn_like(found)
    expected.backward(slope)
    found.backward(slope)
    torch.testing.assert_close(halves[1].grad, halves[0].grad)
    torch.testing.assert_close(layer.conv.weight.grad, weight.grad)
    assert layer.conv.weight.grad is not None
    assert layer.conv.weight.grad.stride() == layer.conv.weight.stride()
